"""The paper (Li, Fischer, Kontar and Ahn, arXiv 2108.10397): its framework, its protocol and its report."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
