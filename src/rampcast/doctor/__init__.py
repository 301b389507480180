"""The data doctor: what is in a recording, what is wrong with it, where, how bad it is, and what to do about it."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
