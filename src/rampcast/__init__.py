"""rampcast forecasts where every vehicle on a highway on-ramp will be, and when it will change lane.

What users need is here (`import rampcast as rc`), and is imported when it is first used. What else is public stands in
docs/api.md; all other modules are internal and may change in any release.
"""

import lazy_loader

__version__ = "0.2.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__all__ = [*__all__, "__version__"]
