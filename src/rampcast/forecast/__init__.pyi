from .forecast import Forecast as Forecast
from .forecaster import Forecaster as Forecaster
from .forecaster import ForecasterSpec as ForecasterSpec
from .forecaster import fit as fit
from .storage import load as load
from .storage import save as save
