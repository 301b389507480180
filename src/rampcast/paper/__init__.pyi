from .forecast import PaperForecast as PaperForecast
from .framework import PaperForecaster as PaperForecaster
from .framework import PaperSpec as PaperSpec
from .framework import fit_paper as fit_paper
from .laws.mode import Mode as Mode
from .neighbours.lstm import LstmSpec as LstmSpec
from .protocol import Evaluation as Evaluation
from .protocol import evaluate as evaluate
