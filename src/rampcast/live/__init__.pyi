from .replay import Replay as Replay
from .service import Choices as Choices
from .service import Service as Service
from .serving import Address as Address
from .serving import serve as serve
from .station import Station as Station
from .web import application as application
