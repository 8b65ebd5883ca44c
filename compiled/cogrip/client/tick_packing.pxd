cpdef bytes pack_tick(
    long long tick, long long late_us, long long work_us, tuple position_m, tuple velocity_mps, tuple force_n, double work_j,
    double port_j, bytes rest, double device_reserve_j,
)
