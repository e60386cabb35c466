"""Coverage: whether 95 % intervals contain the true value, counted over many virtual sensors."""
