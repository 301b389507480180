from .benchmark import benchmark as benchmark
from .doctor import doctor as doctor
from .doctor import inspect as inspect
from .errors import RampcastError as RampcastError
from .forecast import Forecast as Forecast
from .forecast import Forecasts as Forecasts
from .forecast import Online as Online
from .forecast import fit as fit
from .forecast import load as load
from .forecast import save as save
from .formats import read as read
from .plots import plot as plot
from .recording import Recording as Recording
from .recording import clean as clean
from .simulate import shipped_sample as shipped_sample
from .simulate import simulate as simulate
from .sites import Site as Site
from .traffic import Stream as Stream
from .traffic import Traffic as Traffic
from .traffic import moments as moments
from .traffic import traffic as traffic

__version__: str
