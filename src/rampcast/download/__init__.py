"""Public recordings by name: got from their portal, resumed after an interruption, checked before they are used."""

from rampcast.download.catalogue import CATALOGUE, DataSet, data_set, listed
from rampcast.download.download import PORTAL, Download, download, kept
from rampcast.download.transfer import Patience

__all__ = ["CATALOGUE", "PORTAL", "DataSet", "Download", "Patience", "data_set", "download", "kept", "listed"]
