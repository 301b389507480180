"""The LSTMs that predict the neighbours."""
