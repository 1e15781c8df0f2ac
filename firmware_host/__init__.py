"""The host side of the sensor: OpenNI2 streams, recordings, and the synthetic sensor."""
