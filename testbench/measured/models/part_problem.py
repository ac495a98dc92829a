"""What the staged search and the reports ask of a recording of one part, besides `problem.Problem`."""

from typing import NamedTuple

from testbench.tracing.problem.problem import Law, Problem, all_laws


class Family(NamedTuple):
    """A law of many coefficients that follow from one structure: named, and kept or refused, as one."""

    law: Law  # unit and scale are those of each coefficient
    members: tuple  # names of the coefficients
    replaces: tuple = ()  # nuisances that the structure says better: they are 0 beside it


class PartProblem(
    Problem,
    adds="most_laws same_rows quality families axis include_laws dependent_nuisances details replace_data laws_by_name "
    "takes_one_file",
):
    """A recording of one part. Each member has a default.

    most_laws   laws that are added one after the other, at most
    same_rows   rows of fitted and judged segments belong together
    quality     findings about the recording, before anything was fitted
    takes_one_file   True: a kind of which each file is traced by itself
    families    {name: `Family`}: structures that exclude each other; `predict` knows each member as a coefficient
    """

    most_laws, same_rows, quality, families, takes_one_file = 3, False, (), {}, False

    def laws_by_name(self):
        """{name: Law} of catalogue, library and families."""
        return all_laws(self) | {name: family.law for name, family in self.families.items()}

    def axis(self, segment, observable):
        """(abscissa of the rows, its label) of an observable of a segment; None: the number of the row."""
        return None

    def include_laws(self, names):
        """The problem in which these laws are part of the model; None: their coefficients become nuisances."""
        return None

    def dependent_nuisances(self, law):
        """Names of the nuisances that say more of a law that is part of the model, and go where it goes."""
        return ()

    def details(self, law, values):
        """Further keys of a law in a report, from the nuisances {name: fitted value}."""
        return {}

    def replace_data(self, data):
        """The same problem about other features of the same shape: for simulated recordings."""
        raise NotImplementedError
