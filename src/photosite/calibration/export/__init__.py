"""Conversions of a calibration to a sensor description, a noise profile and EMVA 1288 XML, for one camera or many."""
