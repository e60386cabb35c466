from .camera_comparison import compare_cameras as compare_cameras
from .gray_surface import snr as snr
from .sensor_comparison import compare_sensors as compare_sensors
from .sweep import sweep as sweep
