"""A host at the pins of the AXI4-Lite slave: VALID and READY with random wait states, requests in lists.

It keeps the rules of a master: VALID waits for no READY, and what it asks for stays until it is taken.
Shares nothing with the slave.
"""

from typing import NamedTuple

NAMES = "awvalid awaddr wvalid wdata wstrb bready arvalid araddr rready".split()


class Write(NamedTuple):
    """Address, data, strobes; clocks at which address and data were taken and the response came, and the response."""

    address: int
    data: int
    strobes: int
    taken: tuple = ()
    end: int = -1
    response: int = -1


class Read(NamedTuple):
    """Address; clocks at which it was taken and the word came; the word and the response."""

    address: int
    taken: int = -1
    end: int = -1
    word: int = -1
    response: int = -1


class Host:
    """One master with its five channels; `busy` is the share of clocks in which a channel does not wait."""

    def __init__(self, rng, writes=(), reads=(), busy=0.5):
        self.rng, self.busy = rng, busy
        self.writes, self.reads = list(writes), list(reads)
        self.clock, self.offer = 0, {"aw": None, "w": None, "ar": None}
        self.next = {"aw": 0, "w": 0, "ar": 0}
        self.taken = {"aw": [], "w": [], "ar": []}
        self.of_writes, self.of_reads = [], []
        self.pins = dict.fromkeys(NAMES, 0)

    def _offered(self, channel, requests):
        """Place of the request that a channel shows, or None while it waits."""
        if self.offer[channel] is None and self.next[channel] < len(requests) and self.rng.random() < self.busy:
            self.offer[channel] = self.next[channel]
            self.next[channel] += 1
        return self.offer[channel]

    def before(self):
        """Pins of the host at the next edge; where nothing is valid its other pins are noise."""
        draw = self.rng
        pins = {"awaddr": draw.getrandbits(11), "wdata": draw.getrandbits(32), "wstrb": draw.getrandbits(4)}
        pins["araddr"] = draw.getrandbits(11)
        aw, w, ar = (self._offered(c, self.reads if c == "ar" else self.writes) for c in ("aw", "w", "ar"))
        pins |= {"awvalid": int(aw is not None), "wvalid": int(w is not None), "arvalid": int(ar is not None)}
        if aw is not None:
            pins["awaddr"] = self.writes[aw].address
        if w is not None:
            pins |= {"wdata": self.writes[w].data, "wstrb": self.writes[w].strobes}
        if ar is not None:
            pins["araddr"] = self.reads[ar].address
        pins |= {name: int(draw.random() < self.busy) for name in ("bready", "rready")}
        self.pins = {name: pins[name] for name in NAMES}
        return tuple(self.pins.values())

    def behind(self, s):
        """What passes at the edge; `s` has the slave's outputs before it."""
        for channel, ready in (("aw", s.awready), ("w", s.wready), ("ar", s.arready)):
            if self.offer[channel] is not None and ready:
                self.taken[channel].append(self.clock)
                self.offer[channel] = None
        if s.bvalid and self.pins["bready"]:
            k = len(self.of_writes)
            taken = (self.taken["aw"][k], self.taken["w"][k])  # fails for a response without a request
            self.of_writes.append(self.writes[k]._replace(taken=taken, end=self.clock, response=s.bresp))
        if s.rvalid and self.pins["rready"]:
            k = len(self.of_reads)
            found = {"taken": self.taken["ar"][k], "end": self.clock, "word": s.rdata, "response": s.rresp}
            self.of_reads.append(self.reads[k]._replace(**found))
        self.clock += 1

    @property
    def open(self):
        """Requests without a response."""
        return len(self.writes) - len(self.of_writes) + len(self.reads) - len(self.of_reads)
