"""Sweeps: very many runs of a scene with parameters by path, on this machine or a cluster, into a Parquet data set."""
