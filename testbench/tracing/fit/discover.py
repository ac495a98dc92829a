"""When the catalogue fails: which port lacks a force, and which law of the grammar is it.

    F = N a + sum_k c_k f_k + e      F: missing input at a port, whitened; N: nuisances' columns, always free
Orthogonal least squares, forward: each step takes the law that lowers the residual most, until BIC rises; the bootstrap
over blocks says how often each law is chosen. What is chosen is a proposal: it is refitted with the whole model, and
judged as any law. Where a problem cannot estimate inputs, F is the whitened residual and f_k are the laws' signatures.
Source    Chen, Billings & Luo, Int. J. Control 50 (1989); Fasel et al., Proc. R. Soc. A 478 (2022); docs/tracing.md
"""

from typing import NamedTuple

import numpy as np

from testbench.config.toml_text import toml_value
from testbench.tracing.problem.problem import PortForce, all_laws

BOOTSTRAPS, MOST_TERMS, INCLUDED = 100, 4, 0.6


class Selection(NamedTuple):
    """Laws that were chosen for one port."""

    port: str
    unit: str
    laws: tuple
    coefficients: dict
    share: float  # of the projected energy above noise that they explain
    energy: float  # projected chi2 less its rows: what is missing there
    inclusion: dict
    bic: float


def forward(values, columns, nuisance, most=MOST_TERMS):
    """(chosen columns in order, coefficients, residual sum, BIC, first sum) of whitened data; columns (n, K)."""
    q = np.linalg.qr(nuisance)[0] if nuisance.shape[1] else np.zeros((len(values), 0))
    base = residual = values - q @ (q.T @ values)
    column_norms = np.linalg.norm(columns, axis=0)
    projected_columns = columns - q @ (q.T @ columns)
    chosen, n = [], len(values)
    best, start = float(residual @ residual), float(residual @ residual)
    remaining = projected_columns.copy()
    while len(chosen) < most:
        length = np.linalg.norm(remaining, axis=0)
        usable = length > 1e-6 * np.where(column_norms > 0, column_norms, np.inf)
        usable[chosen] = False
        if not usable.any():
            break
        gain = np.where(usable, (remaining.T @ residual) ** 2 / np.where(usable, length, 1.0) ** 2, -1.0)
        k = int(np.argmax(gain))
        if gain[k] < np.log(n) + 2 * np.log(columns.shape[1]):
            break
        u = remaining[:, k] / length[k]
        residual = residual - u * (u @ residual)
        remaining = remaining - np.outer(u, u @ remaining)
        chosen.append(k)
        best = float(residual @ residual)
    c = np.linalg.lstsq(projected_columns[:, chosen], base, rcond=None)[0] if chosen else np.zeros(0)
    return chosen, c, best, best + len(chosen) * (np.log(n) + 2 * np.log(columns.shape[1])), start


def select(force, rng, bootstraps=BOOTSTRAPS):
    """`Selection` for a `PortForce`."""
    names = tuple(force.columns)
    columns = np.stack([force.columns[n] for n in names], axis=1) if names else np.zeros((len(force.values), 0))
    good = np.isfinite(columns).all(axis=0)
    names, columns = tuple(n for n, ok in zip(names, good) if ok), columns[:, good]
    if not names:
        return Selection(force.port, force.unit, (), {}, 0.0, 0.0, {}, float("nan"))
    chosen, c, residual_energy, bic, start = forward(force.values, columns, force.nuisance)
    blocks = np.unique(force.block)
    rows = {b: np.flatnonzero(force.block == b) for b in blocks}
    counts = dict.fromkeys(names, 0)
    for _ in range(bootstraps):
        at = np.concatenate([rows[b] for b in rng.choice(blocks, len(blocks))])
        for k in forward(force.values[at], columns[at], force.nuisance[at])[0]:
            counts[names[k]] += 1
    energy = start - (len(force.values) - np.linalg.matrix_rank(force.nuisance))
    return Selection(
        force.port,
        force.unit,
        tuple(names[k] for k in chosen),
        {names[k]: float(x) for k, x in zip(chosen, c)},
        float((start - residual_energy) / energy) if energy > 0 else 0.0,
        float(energy),
        {n: k / bootstraps for n, k in counts.items() if k},
        float(bic),
    )


def forces(problem, fit, ranking):
    """`PortForce`s: the problem's own estimates, or signatures in feature space, per port of the laws."""
    port_forces = problem.force_at(fit.point.theta, fit.model.effects(fit.point))
    if port_forces:
        return list(port_forces)
    laws, space = all_laws(problem), fit.model.space
    block = np.zeros(space.size, int)
    for i, b in enumerate(space.blocks):
        block[b.rows] = b.group if len(space.groups) > 3 else i
    out = []
    for port in sorted({laws[name].port for name in ranking.names}):
        columns = {n: ranking.signatures[:, i] for i, n in enumerate(ranking.names) if laws[n].port == port}
        out.append(PortForce(port, "sigma", fit.z, columns, fit.jacobian, block))
    return out


def discover(problem, fit, ranking, seed):
    """`Selection`s per port, the one that explains most first."""
    rng = np.random.default_rng([seed, 6])
    port_selections = [select(force, rng) for force in forces(problem, fit, ranking)]
    return sorted(port_selections, key=lambda s: (-s.share * max(s.energy, 0.0), s.port))


def proposals(port_selections):
    """Sets of laws to refit: what was chosen at each port, and its single laws that the bootstrap keeps."""
    out = []
    for s in port_selections:
        if s.laws:
            out.append(tuple(sorted(s.laws)))
            out += [(law,) for law in s.laws if s.inclusion.get(law, 0.0) >= INCLUDED]
    return list(dict.fromkeys(out))


def lift(law, value, sd, hashes):
    """Text of a TOML file that makes a found law an effect of the configuration: port, term, coefficient, where from.

    [[effects]] law, port, coefficient, sd, unit, text, term = {x = 3.0, ...}, [effects.found_in] hashes
    """
    rows = {"law": law.name, "port": law.port, "coefficient": float(value), "sd": float(sd), "unit": law.unit}
    rows["text"] = law.text
    rows["term"] = {str(k): v for k, v in law.term}
    lines = ["[[effects]]"] + [f"{key} = {toml_value(v)}" for key, v in rows.items()]
    lines += ["", "[effects.found_in]"] + [f"{toml_value(str(k))} = {toml_value(str(v))}" for k, v in hashes.items()]
    return "\n".join(lines) + "\n"
