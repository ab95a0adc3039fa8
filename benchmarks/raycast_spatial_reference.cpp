// Accumulation in space as plainly as it can be written: the walk of Amanatides and Woo (1987), one ray after the other.
//
// Compiled with -O3 -march=native and measured against by raycast.py. It does less than the package: path lengths are
// rounded to float and added in the order of the rays, misses are not counted, and no ray may leave the grid.

#include <cmath>
#include <cstdint>
#include <cstdlib>

extern "C" int64_t accumulate_spatial(
    const double* origins,     // (rays, 3), m, in the frame of the grid
    const double* directions,  // (rays, 3), unit vectors
    const double* lengths,     // (rays), m
    int64_t rays,
    const double* low,         // (3), m, lowest corner of the grid without its rim of one cell
    double resolution,         // m
    int64_t stride_x,          // cells with rim in a layer across x
    int64_t stride_y,          // cells along z, with rim
    float* path,               // (cells with rim), m, added to
    uint32_t* hits) {          // (cells with rim), added to
  const double inverse = 1.0 / resolution;
  int64_t visited = 0;
  for (int64_t k = 0; k < rays; ++k) {
    const double p_x = (origins[3 * k] - low[0]) * inverse + 1.0;
    const double p_y = (origins[3 * k + 1] - low[1]) * inverse + 1.0;
    const double p_z = (origins[3 * k + 2] - low[2]) * inverse + 1.0;
    const double v_x = directions[3 * k] * inverse;
    const double v_y = directions[3 * k + 1] * inverse;
    const double v_z = directions[3 * k + 2] * inverse;
    const double length = lengths[k];
    const auto i_x = static_cast<int64_t>(std::floor(p_x));
    const auto i_y = static_cast<int64_t>(std::floor(p_y));
    const auto i_z = static_cast<int64_t>(std::floor(p_z));
    const int64_t planes_x = std::llabs(static_cast<int64_t>(std::floor(p_x + v_x * length)) - i_x);
    const int64_t planes_y = std::llabs(static_cast<int64_t>(std::floor(p_y + v_y * length)) - i_y);
    const int64_t planes_z = std::llabs(static_cast<int64_t>(std::floor(p_z + v_z * length)) - i_z);
    const double d_x = 1.0 / std::fabs(v_x);
    const double d_y = 1.0 / std::fabs(v_y);
    const double d_z = 1.0 / std::fabs(v_z);
    // A ray along a plane may cross it by its direction and not by its end, which is rounded; the end decides.
    double t_x = planes_x > 0 ? (v_x > 0.0 ? i_x + 1 - p_x : p_x - i_x) * d_x : HUGE_VAL;
    double t_y = planes_y > 0 ? (v_y > 0.0 ? i_y + 1 - p_y : p_y - i_y) * d_y : HUGE_VAL;
    double t_z = planes_z > 0 ? (v_z > 0.0 ? i_z + 1 - p_z : p_z - i_z) * d_z : HUGE_VAL;
    const int64_t step_x = v_x > 0.0 ? stride_x : -stride_x;
    const int64_t step_y = v_y > 0.0 ? stride_y : -stride_y;
    const int64_t step_z = v_z > 0.0 ? 1 : -1;
    const int64_t crossings = planes_x + planes_y + planes_z;
    int64_t cell = i_x * stride_x + i_y * stride_y + i_z;
    double t = 0.0;
    for (int64_t n = 0; n < crossings; ++n) {
      if (t_x < t_y && t_x < t_z) {
        path[cell] += static_cast<float>(t_x - t);
        t = t_x;
        t_x += d_x;
        cell += step_x;
      } else if (t_y < t_z) {
        path[cell] += static_cast<float>(t_y - t);
        t = t_y;
        t_y += d_y;
        cell += step_y;
      } else {
        path[cell] += static_cast<float>(t_z - t);
        t = t_z;
        t_z += d_z;
        cell += step_z;
      }
    }
    path[cell] += static_cast<float>(length - t);
    ++hits[cell];
    visited += crossings + 1;
  }
  return visited;
}
