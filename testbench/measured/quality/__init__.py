"""Data quality of recordings, before any law is fitted: one file, one check.   Source  docs/quality.md"""
