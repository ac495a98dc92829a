"""Workers on a Dask cluster: the scheduler of `--scheduler`, or one of our own for `--cluster`. `run` is as in `pool`.

Workers write into the store, a folder that all machines of the cluster share; results do not travel through the
scheduler. A worker that dies is Dask's to replace: it runs the batch again elsewhere, up to its allowed-failures.
Whoever can talk to a scheduler runs code as its user, so both sides show a certificate: our own cluster has temporary
ones, `--scheduler` those of Dask's configuration.
Source  docs/campaigns.md, docs/decisions/0011-workers-of-a-campaign.md
"""

import asyncio
import concurrent.futures
import contextlib
import logging
import queue
import re
import tempfile
import time

from testbench.campaign import work
from testbench.errors import ConfigError
from testbench.interrupts import defer_interrupts

ADDRESS = re.compile(r"((tcp|tls|ws|wss)://)?([\w.-]+|\[[0-9a-fA-F:]+\]):\d{1,5}")
ENCRYPTED = ("tls://", "wss://")
CERTIFICATES = {"tls_ca_file": "ca-file", "tls_client_cert": "client.cert"}  # of a client, and their keys
CONNECT_S = 5.0
NO_WORKER_S = 30.0
POLL_S = 0.5
SILENT = logging.CRITICAL + 1
WORKER_LOG = "distributed.nanny.pre-spawn-environ.DASK_LOGGING__DISTRIBUTED"
TRIES = 3
INSTALL = "{} is not installed; run pip install '.[campaign]' in the clone"


class ClusterError(ConfigError):
    """A cluster that does not answer, has no workers, or was lost."""


class Cluster:
    """Dask workers: those of the scheduler at `address`, or `workers` processes of a cluster of our own.

    unencrypted  permits an address without certificates
    """

    def __init__(self, address=None, workers=0, unencrypted=False):
        self.option = "--unencrypted-scheduler" if unencrypted else "--scheduler"
        if address is not None and not ADDRESS.fullmatch(address):
            raise ClusterError(f"{self.option} {address}: is not of the form tls://HOST:PORT")
        if address is not None and not (unencrypted or address.startswith(ENCRYPTED)):
            raise ClusterError(
                f"--scheduler {address}: has no certificates, so anyone who reaches it can run code as you; "
                f"use tls://, or in a trusted network --unencrypted-scheduler {address}"
            )
        self.address, self.workers = address, workers
        self._stack = contextlib.ExitStack()

    def __enter__(self):
        try:
            import distributed
        except ImportError:
            raise ClusterError(INSTALL.format("Dask")) from None
        # what Dask says about lost connections is said here, in one line
        for name in [*logging.root.manager.loggerDict, "tornado.application", "asyncio"]:
            if name.split(".")[0] in ("distributed", "tornado", "asyncio"):
                logging.getLogger(name).setLevel(SILENT)
        try:
            if self.address is None:
                security = self._start_local_cluster(distributed)
            else:
                security = self._load_certificates(distributed)
            self._client = self._stack.enter_context(
                distributed.Client(self.address, timeout=CONNECT_S, set_as_default=False, security=security)
            )
            self._wait_for_workers()
        except (OSError, TimeoutError) as problem:
            self._close()
            raise ClusterError(
                f"{self.option} {self.address}: no Dask scheduler answered within {CONNECT_S:g} s "
                f"({type(problem).__name__}: {problem})"
            ) from None
        except BaseException:
            self._close()
            raise
        return self

    def _start_local_cluster(self, distributed):
        """Certificates of a cluster of our own, which stands then."""
        import dask

        from testbench.campaign import dask_nodes

        try:
            security = distributed.Security.temporary()
        except ImportError:
            raise ClusterError(INSTALL.format("cryptography")) from None
        # Dask's own folder in /tmp is whoever made it first
        folder = self._stack.enter_context(tempfile.TemporaryDirectory(ignore_cleanup_errors=True))
        # half a cluster cannot be closed, so Ctrl-C waits until it stands
        with dask.config.set({WORKER_LOG: "critical"}), defer_interrupts():
            cluster = dask_nodes.cluster(self.workers, security, folder, SILENT)
            self.address = self._stack.enter_context(cluster).scheduler_address
        return security

    def _load_certificates(self, distributed):
        """Certificates of Dask's configuration, which an encrypted address needs."""
        security = distributed.Security()
        lacking = [key for key in CERTIFICATES if not getattr(security, key)]
        if self.address.startswith(ENCRYPTED) and lacking:
            keys = ", ".join(f"distributed.comm.tls.{CERTIFICATES[key]}" for key in lacking)
            raise ClusterError(f"{self.option} {self.address}: Dask's configuration has no {keys}")
        return security

    def _wait_for_workers(self):
        until = time.monotonic() + NO_WORKER_S
        while not self._client.scheduler_info()["workers"]:
            if time.monotonic() > until:
                raise ClusterError(f"{self.address}: the scheduler has had no workers for {NO_WORKER_S:g} s")
            time.sleep(POLL_S)
        self.workers = sum(w["nthreads"] for w in self._client.scheduler_info()["workers"].values())

    def __exit__(self, *_):
        self._close()

    def _close(self):
        # a cluster that is gone cannot be told goodbye
        with contextlib.suppress(Exception):
            self._stack.close()

    def run(self, store, batches):
        """Yield lists of `work.Outcome` as batches end; ClusterError when the scheduler is lost."""
        finished_future_keys = queue.SimpleQueue()
        futures = {}

        def submit(batch, tries):
            future = self._client.submit(
                work.run_batch,
                str(store.path),
                store.name,
                batch,
                key=f"gyro-{batch.addresses[0]}-{len(batch.identities)}-{tries}",
                pure=False,
            )
            futures[future.key] = future, batch, tries
            future.add_done_callback(lambda f: finished_future_keys.put(f.key))

        for batch in batches:
            submit(batch, 1)
        silent_since = None
        while futures:
            try:
                key = finished_future_keys.get(timeout=POLL_S)
            except queue.Empty:
                silent_since = self._check(silent_since)
                continue
            future, batch, tries = futures.pop(key)
            if future.status == "finished":
                yield self._result(future)
            elif future.status == "error":
                failures = [self._failure(address, future) for address in batch.addresses]
                if len(failures) > 1 and all(failure.status == work.FAILED for failure in failures):
                    for one in batch.split():
                        submit(one, 1)
                else:
                    yield failures
            elif tries < TRIES and self._client.status == "running":
                submit(batch, tries + 1)
            else:
                raise self._lost()

    def _result(self, future):
        """What a future holds; its way here is the scheduler's, so no answer means that this is lost."""
        try:
            return future.result(timeout=NO_WORKER_S)
        except (OSError, TimeoutError, asyncio.CancelledError, concurrent.futures.CancelledError):
            raise self._lost() from None

    def _check(self, since):
        """ClusterError if the connection is gone for `CONNECT_S`; else since when it is, or None."""
        if self._client.status == "running":
            return None
        now = time.monotonic()
        since = since or now
        if self._client.status == "closed" or now - since > CONNECT_S:
            raise self._lost()
        return since

    def _lost(self):
        return ClusterError(f"{self.address}: the connection to the Dask scheduler was lost")

    @staticmethod
    def _failure(address, future):
        problem = future.exception()
        name = type(problem).__name__
        if isinstance(problem, ImportError):
            return work.Outcome(address, work.STOP, f"a Dask worker cannot import the code of the point: {problem}")
        if name == "KilledWorker":
            return work.Outcome(address, work.FAILED, f"the workers that ran this point died ({problem.last_worker})")
        return work.Outcome(address, work.FAILED, f"{name}: {problem}")
