"""Campaigns: many runs from one plan, kept by content in one store, resumable at any moment.

    plan.toml -> plan -> points (identity, address) -> execute -> work, in local processes or on a Dask cluster
                                                                   |-> engine -> measure -> shard -> store
                                      store -> collect -> results/NAME.nc, results/NAME.csv

Source  docs/campaigns.md
"""
