#include "network/validation.hpp"

#include <algorithm>
#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <numeric>

#include "tessellation/exchange.hpp"

namespace poreslip {
namespace {

[[gnu::format(printf, 1, 2)]] std::string text(const char* format, ...) {
  char buffer[512];
  va_list arguments;
  va_start(arguments, format);
  std::vsnprintf(buffer, sizeof buffer, format, arguments);
  va_end(arguments);
  return buffer;
}

// m, of a box: beyond, squares of its volumes are no numbers of the computer any more.
constexpr double least_length = 1e-40, most_length = 1e40;

// Of the box's length, for a grain's diameter: one that reaches from wall to wall may overlap both as pressed grains do.
constexpr double most_of_box = 1.1;

constexpr const char* wall_name[6] = {"x low", "x high", "y low", "y high", "z low", "z high"};
constexpr char axis_name[3] = {'x', 'y', 'z'};

}  // namespace

std::string check_domain(const Domain& domain) {
  for (int d = 0; d < 3; ++d) {
    if (!std::isfinite(domain.lower[d]) || !std::isfinite(domain.upper[d]) || !(domain.upper[d] > domain.lower[d]))
      return text("the box from %g to %g m in %c is not a box: lower and upper must be finite and lower < upper",
                  domain.lower[d], domain.upper[d], axis_name[d]);
    if (const double length = domain.upper[d] - domain.lower[d]; !(length >= least_length && length <= most_length))
      return text("the box is %g m long in %c: expected %g to %g m; look at its unit", length, axis_name[d], least_length, most_length);
  }
  return {};
}

std::string check_grains(const GrainInput& input, const Domain& domain) {
  for (std::size_t g = 0; g < input.groups; ++g)
    for (int w = 0; w < 6; ++w) {
      if (!domain.has_wall(w)) continue;
      const double* plane = input.wall_position + 6 * g;
      if (!std::isfinite(plane[w]))
        return text("wall_position[%zu, %d] (%s) is %g: the plane of a wall must be a finite position in m", g, w,
                    wall_name[w], plane[w]);
      if (w % 2 == 1 && !(plane[w] > plane[w - 1]))
        return text("wall_position[%zu]: the %s plane at %.9g m is not above the %s plane at %.9g m", g, wall_name[w],
                    plane[w], wall_name[w - 1], plane[w - 1]);
    }
  for (std::size_t i = 0; i < input.count; ++i) {
    const long long id = input.id[i];
    const double* x = input.position + 3 * i;
    if (id < 0) return text("grain id %lld is negative: ids are 0 or more", id);
    if (!std::isfinite(x[0]) || !std::isfinite(x[1]) || !std::isfinite(x[2]))
      return text("grain %lld has position (%g, %g, %g): positions must be finite numbers in m", id, x[0], x[1], x[2]);
    if (!std::isfinite(input.radius[i]) || !(input.radius[i] > 0.0))
      return text("grain %lld has radius %g m: radii must be finite and positive", id, input.radius[i]);
    for (int d = 0; d < 3; ++d) {
      const std::int32_t g = input.group && input.group[i] >= 0 && static_cast<std::size_t>(input.group[i]) < input.groups ? input.group[i] : 0;
      const double* plane = input.wall_position + 6 * g + 2 * d;
      const double length = domain.periodic[d] ? domain.upper[d] - domain.lower[d] : plane[1] - plane[0];
      if (2.0 * input.radius[i] > most_of_box * length)
        return text("grain %lld has radius %g m: it is too big for the box, which is %g m long in %c", id, input.radius[i], length, axis_name[d]);
    }
    const std::int32_t group = input.group ? input.group[i] : 0;
    if (group < 0 || static_cast<std::size_t>(group) >= input.groups)
      return text("grain %lld is of group %d: wall_position has rows 0 to %zu", id, group, input.groups - 1);
    for (int w = 0; w < 6; ++w) {
      if (!domain.has_wall(w)) continue;
      const double plane = input.wall_position[6 * group + w];
      if (!(wall_sign(w) * (plane - x[wall_axis(w)]) > 0.0))
        return text("grain %lld at (%.9g, %.9g, %.9g) m is outside the box: its centre must lie inside the %s wall at %.9g m "
                    "(group %d); move the grain or the wall, or make %c periodic",
                    id, x[0], x[1], x[2], wall_name[w], plane, group, axis_name[wall_axis(w)]);
    }
  }
  return {};
}

std::string check_unique_ids(MPI_Comm comm, const std::vector<std::int64_t>& id) {
  int ranks = 1;
  MPI_Comm_size(comm, &ranks);
  // Every id goes to the rank that its value names, which sees all its occurrences.
  std::vector<int> send_count(ranks, 0);
  for (const std::int64_t v : id) ++send_count[v % ranks];
  std::vector<int> next(ranks);
  std::exclusive_scan(send_count.begin(), send_count.end(), next.begin(), 0);
  std::vector<std::int64_t> sent(id.size());
  for (const std::int64_t v : id) sent[next[v % ranks]++] = v;
  std::vector<std::int64_t> received = exchange(comm, sent, send_count, exchange_counts(comm, send_count));
  std::sort(received.begin(), received.end());
  const auto twice = std::adjacent_find(received.begin(), received.end());
  if (twice == received.end()) return {};
  return text("grain id %lld occurs more than once: every grain belongs to one rank and has an id of its own",
              static_cast<long long>(*twice));
}

}  // namespace poreslip
