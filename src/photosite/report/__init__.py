"""Reports: pages of tables and figures made from results, written as HTML or PDF."""
