"""One file an effect, by the name of its section: how studies draw it, and its true values."""
