"""The service: frames of a site in, forecasts of all its vehicles out, to programs and to a page in the browser."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
