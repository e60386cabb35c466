"""Text files of lens-design programs: point spreads, distortion, relative illumination. `design_files` and `ray_trace`
make lenses of many of them."""
