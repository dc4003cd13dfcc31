"""Of what operations a traced program consists."""

from jax.extend.core import subjaxprs

LAPACK = {"lu", "qr", "cholesky", "eigh", "eig", "svd", "schur", "hessenberg", "triangular_solve", "geqrf"}
"""Operations of JAX that are calls of LAPACK on a CPU."""


def operations(jaxpr):
    """Names of all operations, those in loops, branches and functions too."""
    inner = [operations(each) for each in subjaxprs(jaxpr)]
    return {equation.primitive.name for equation in jaxpr.eqns}.union(*inner)
