// Accumulation as plainly as it can be written: the walk of Amanatides and Woo (1987), one ray after the other.
//
// Compiled with -O3 -march=native and measured against by raycast.py. It does less than the package: path lengths are
// rounded to float and added in the order of the rays, misses are not counted, and no ray may leave the grid.

#include <cmath>
#include <cstdint>
#include <cstdlib>

extern "C" int64_t accumulate(
    const double* origins,     // (rays, 2), m, in the frame of the grid
    const double* directions,  // (rays, 2), unit vectors
    const double* lengths,     // (rays), m
    int64_t rays,
    const double* low,         // (2), m, lowest corner of the grid without its rim of one cell
    double resolution,         // m
    int64_t stride,            // cells along y, with rim
    float* path,               // (cells with rim), m, added to
    uint32_t* hits) {          // (cells with rim), added to
  const double inverse = 1.0 / resolution;
  int64_t visited = 0;
  for (int64_t k = 0; k < rays; ++k) {
    const double p_x = (origins[2 * k] - low[0]) * inverse + 1.0;
    const double p_y = (origins[2 * k + 1] - low[1]) * inverse + 1.0;
    const double v_x = directions[2 * k] * inverse;
    const double v_y = directions[2 * k + 1] * inverse;
    const double length = lengths[k];
    const auto i_x = static_cast<int64_t>(std::floor(p_x));
    const auto i_y = static_cast<int64_t>(std::floor(p_y));
    const auto e_x = static_cast<int64_t>(std::floor(p_x + v_x * length));
    const auto e_y = static_cast<int64_t>(std::floor(p_y + v_y * length));
    const int64_t lines_x = std::llabs(e_x - i_x);
    const int64_t lines_y = std::llabs(e_y - i_y);
    const double d_x = 1.0 / std::fabs(v_x);
    const double d_y = 1.0 / std::fabs(v_y);
    // A ray along a line may cross it by its direction and not by its end, which is rounded; the end decides.
    double t_x = lines_x > 0 ? (v_x > 0.0 ? i_x + 1 - p_x : p_x - i_x) * d_x : HUGE_VAL;
    double t_y = lines_y > 0 ? (v_y > 0.0 ? i_y + 1 - p_y : p_y - i_y) * d_y : HUGE_VAL;
    const int64_t step_x = v_x > 0.0 ? stride : -stride;
    const int64_t step_y = v_y > 0.0 ? 1 : -1;
    const int64_t crossings = lines_x + lines_y;
    int64_t cell = i_x * stride + i_y;
    double t = 0.0;
    for (int64_t n = 0; n < crossings; ++n) {
      if (t_x < t_y) {
        path[cell] += static_cast<float>(t_x - t);
        t = t_x;
        t_x += d_x;
        cell += step_x;
      } else {
        path[cell] += static_cast<float>(t_y - t);
        t = t_y;
        t_y += d_y;
        cell += step_y;
      }
    }
    path[cell] += static_cast<float>(length - t);
    ++hits[cell];
    visited += crossings + 1;
  }
  return visited;
}
