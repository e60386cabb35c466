"""Maps of one chip: offset, response, dark rate, read noise, defects, and the temporal noise behind them."""
