#include "flow/parts.hpp"

#include <algorithm>
#include <array>
#include <cstdio>
#include <map>
#include <numeric>
#include <unordered_map>

#include "flow/sum.hpp"
#include "tessellation/agreement.hpp"

namespace poreslip::flow {
namespace {

using Pair = std::array<std::int64_t, 2>;

void tidy(std::vector<Pair>& pairs) {
  std::sort(pairs.begin(), pairs.end());
  pairs.erase(std::unique(pairs.begin(), pairs.end()), pairs.end());
}

// Those of all ranks, rank by rank.
std::vector<Pair> gathered(MPI_Comm comm, const std::vector<Pair>& pairs) {
  int ranks = 1, own = static_cast<int>(2 * pairs.size());
  MPI_Comm_size(comm, &ranks);
  std::vector<int> count(ranks), start(ranks, 0);
  MPI_Allgather(&own, 1, MPI_INT, count.data(), 1, MPI_INT, comm);
  for (int r = 1; r < ranks; ++r) start[r] = start[r - 1] + count[r - 1];
  std::vector<Pair> all((start.back() + count.back()) / 2);
  MPI_Allgatherv(pairs.data(), own, MPI_INT64_T, all.data(), count.data(), start.data(), MPI_INT64_T, comm);
  return all;
}

}  // namespace

std::vector<std::int64_t> connected_parts(PoreNetwork& network, const Throats& throats) {
  const Mesh& mesh = network.mesh();
  const auto n = static_cast<std::int32_t>(network.pores());
  // Trees of the pores that this rank's own throats join, each under its first pore.
  std::vector<std::int32_t> tree(n);
  std::iota(tree.begin(), tree.end(), 0);
  const auto root = [&tree](std::int32_t c) {
    while (tree[c] != c) c = tree[c] = tree[tree[c]];
    return c;
  };
  for (std::size_t f = 0; f < throats.conductance.size(); ++f) {
    if (throats.conductance[f] == 0.0) continue;
    const std::int32_t a = root(mesh.facet.left[f]), b = root(mesh.facet.right[f]);
    tree[std::max(a, b)] = std::min(a, b);
  }
  for (std::int32_t c = 0; c < n; ++c) tree[c] = root(c);
  // A tree's number is that of its first pore, counted over all ranks.
  std::int64_t before = 0, count = n;
  MPI_Comm comm = network.communicator();
  int rank = 0;
  MPI_Comm_rank(comm, &rank);
  MPI_Exscan(&count, &before, 1, MPI_INT64_T, MPI_SUM, comm);
  if (rank == 0) before = 0;
  std::vector<std::int64_t> part(n);
  // A pore and its copies are one: their trees are joined, on all ranks alike.
  for (std::int32_t c = 0; c < n; ++c) part[c] = before + tree[c];
  std::vector<std::int64_t> owners = part;
  network.exchange().fetch(owners.data());
  std::vector<Pair> links;
  for (std::int32_t c = 0; c < n; ++c)
    if (owners[c] != part[c]) links.push_back({part[c], owners[c]});
  tidy(links);
  std::unordered_map<std::int64_t, std::int64_t> joined;
  const auto part_of = [&joined](std::int64_t p) {
    for (auto found = joined.find(p); found != joined.end(); found = joined.find(p)) p = found->second;
    return p;
  };
  for (const Pair& link : gathered(comm, links)) {
    const std::int64_t a = part_of(link[0]), b = part_of(link[1]);
    if (a != b) joined[std::max(a, b)] = std::min(a, b);
  }
  if (!joined.empty())
    for (std::int64_t& p : part) p = part_of(p);
  return part;
}

std::int64_t fix_cut_off(PoreNetwork& network, const std::vector<std::int64_t>& part, std::vector<std::uint8_t>& fixed) {
  std::vector<Pair> own;
  for (std::size_t c = 0; c < part.size(); ++c)
    if (fixed[c]) own.push_back({part[c], 0});
  tidy(own);
  std::vector<Pair> reached = gathered(network.communicator(), own);
  tidy(reached);
  std::int64_t count = 0;
  for (std::size_t c = 0; c < part.size(); ++c) {
    if (fixed[c] || std::binary_search(reached.begin(), reached.end(), Pair{part[c], 0})) continue;
    fixed[c] = 1;
    count += network.owned()[c];
  }
  return sum(network.communicator(), count);
}

std::int64_t fix_isolated(PoreNetwork& network, const Throats& throats, std::vector<std::uint8_t>& fixed) {
  const Mesh& mesh = network.mesh();
  const PoreExchange& exchange = network.exchange();
  std::vector<double> open(fixed.size(), 0.0);
  for (std::size_t f = 0; f < throats.conductance.size(); ++f) {
    const std::int32_t a = mesh.facet.left[f], b = mesh.facet.right[f];
    // A throat to a pore's own image leads nowhere else.
    const bool same = exchange.owner_rank(a) == exchange.owner_rank(b) && exchange.owner_index(a) == exchange.owner_index(b);
    if (throats.conductance[f] > 0.0 && !same) open[a] = open[b] = 1.0;
  }
  exchange.add_to_owner(open.data());
  exchange.fetch(open.data());
  std::int64_t count = 0;
  for (std::size_t c = 0; c < fixed.size(); ++c) {
    if (fixed[c] || open[c] > 0.0) continue;
    fixed[c] = 1;
    count += network.owned()[c];
  }
  return sum(network.communicator(), count);
}

void refuse_several(PoreNetwork& network, const std::vector<std::int64_t>& part, const std::vector<std::uint8_t>& fixed) {
  MPI_Comm comm = network.communicator();
  std::map<std::int64_t, std::int64_t> pores, all;
  for (std::size_t c = 0; c < part.size(); ++c)
    if (network.owned()[c] && !fixed[c]) ++pores[part[c]];
  std::vector<Pair> own;
  for (const auto& [p, count] : pores) own.push_back({p, count});
  for (const Pair& found : gathered(comm, own)) all[found[0]] += found[1];
  if (all.size() < 2) return;
  // Of equally small ones the first.
  const auto smallest = std::min_element(all.begin(), all.end(), [](const auto& a, const auto& b) { return a.second < b.second; });
  std::string fault;
  for (std::size_t c = 0; c < part.size() && fault.empty(); ++c) {
    if (!network.owned()[c] || fixed[c] || part[c] != smallest->first) continue;
    std::vector<double> centre(3 * part.size());
    network.pore_centre(centre.data());
    char text[400];
    std::snprintf(text, sizeof text,
                  "no pressure is given anywhere, nothing is stored, and open throats join the pores to %zu separate parts, in each of which the pressure "
                  "is undetermined; the smallest, of %lld pores, has one at (%.9g, %.9g, %.9g) m: give a pressure at a face or pore, or solve in time "
                  "steps with a compressible fluid",
                  all.size(), static_cast<long long>(smallest->second), centre[3 * c], centre[3 * c + 1], centre[3 * c + 2]);
    fault = text;
  }
  agree_on_input(comm, fault);
}

}  // namespace poreslip::flow
