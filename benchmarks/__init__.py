"""Benchmarks: each published table and each performance ratio, one file and one command."""
