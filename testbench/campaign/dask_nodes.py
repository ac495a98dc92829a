"""Scheduler and worker of a Dask cluster of our own. Dask's serve pages by HTTP without authentication; these do not.

Source  docs/campaigns.md
"""

import distributed

LOOPBACK = "127.0.0.1"


class Scheduler(distributed.Scheduler):
    """Without a page."""

    def start_http_server(self, *_args, **_options):
        """Nothing listens."""


class Worker(distributed.Worker):
    """Without a page."""

    def start_http_server(self, *_args, **_options):
        """Nothing listens."""


def cluster(workers, security, folder, silence_logs):
    """`distributed.SpecCluster` of so many workers of one thread; only who has the certificates can talk to it."""
    common = {"host": LOOPBACK, "protocol": "tls://", "security": security}
    options = {"worker_class": Worker, "nthreads": 1, "memory_limit": 1 / workers, "local_directory": folder}
    nanny = {"cls": distributed.Nanny, "options": {**common, **options, "silence_logs": silence_logs}}
    return distributed.SpecCluster(
        scheduler={"cls": Scheduler, "options": {**common, "port": 0, "dashboard": False}},
        workers=dict.fromkeys(range(workers), nanny),
        security=security,
    )
