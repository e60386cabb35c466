"""One file a measurement, by its id: charts whose image quality is drawn at random and known in closed form."""
