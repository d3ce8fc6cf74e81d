"""allanscope: live Allan-variance monitor for LSM6DS3H / LSM6DSL / LSM6DSM inertial sensors."""
