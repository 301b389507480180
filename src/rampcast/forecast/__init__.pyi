from .forecast import Forecast as Forecast
from .forecaster import Forecaster as Forecaster
from .forecaster import ForecasterSpec as ForecasterSpec
from .forecaster import fit as fit
from .forecasts import Forecasts as Forecasts
from .online import Online as Online
from .storage import load as load
from .storage import save as save
