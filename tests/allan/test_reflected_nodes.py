"""The quadrature behind the degrees of freedom of the modified totals."""

import numpy as np

from allanscope.allan.estimators.reflected import _nodes


def test_quadrature_is_exact_for_even_powers_up_to_its_degree():
    node, weight = _nodes()
    powers = np.arange(0, 2 * len(node), 2)
    found = weight @ node[:, np.newaxis] ** powers
    np.testing.assert_allclose(found, 2.0 / (powers + 1.0), rtol=1e-12)
