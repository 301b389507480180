from .recording import Recording as Recording
from .recording import concatenate as concatenate
from .recording import read_recording as read_recording
from .recording import write_recording as write_recording
from .recording import write_recordings as write_recordings
from .smoothing import CleaningReport as CleaningReport
from .smoothing import clean as clean
