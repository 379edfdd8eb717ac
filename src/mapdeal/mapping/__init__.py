"""Maps from sensor data: functions from arrays to grids."""
