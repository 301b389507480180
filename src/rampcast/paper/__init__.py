"""The paper (Li, Fischer, Kontar and Ahn, arXiv 2108.10397): its framework, its protocol and its report."""
