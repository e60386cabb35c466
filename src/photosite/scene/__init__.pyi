from . import charts as charts
from . import lights as lights
from . import pictures as pictures
from . import render as render
from . import scenes as scenes
