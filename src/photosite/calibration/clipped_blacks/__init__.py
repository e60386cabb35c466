"""Dark frames clipped at 0: censored likelihood and correction of levels."""
