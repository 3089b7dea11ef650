#include <mpi.h>

#include "fix_bond_settings.h"

#include <algorithm>
#include <cstring>
#include <type_traits>
#include <unordered_map>

#include "arguments.h"
#include "atom.h"
#include "bond_history.h"
#include "comm.h"
#include "contacts.h"
#include "fix_contact_history.h"
#include "force.h"
#include "modify.h"
#include "pair_gran_proxy.h"

namespace poreslip {

namespace {

static_assert(std::is_trivially_copyable_v<BrokenPair>);  // sent and stored as bytes

bool not_negative(double value) { return value >= 0.0 && std::isfinite(value); }
bool not_negative_or_infinite(double value) { return value >= 0.0; }

}  // namespace

FixBondSettings::FixBondSettings(LAMMPS_NS::LAMMPS *lmp, int narg, char **arg) :
    Fix(lmp, narg, arg), state_(state_of(lmp))
{
  Arguments arguments(lmp, std::string("fix ") + id + " bond/settings", narg, arg, 3);
  settings_.group_bit = groupbit;
  settings_.types = atom->ntypes;
  settings_.bondable.assign((atom->ntypes + 1) * (atom->ntypes + 1), 0);
  bool has_mean = false, has_deviation = false, has_floor = false, has_seed = false, has_types = false, has_armed = false;
  while (!arguments.done()) {
    const std::string keyword = arguments.word("keyword", "");
    if (keyword == "strength_mean") {
      settings_.strength.mean = arguments.number(keyword, not_negative_or_infinite, "0 or more (Pa), or infinite");
      has_mean = true;
    } else if (keyword == "strength_sd") {
      settings_.strength.standard_deviation = arguments.number(keyword, not_negative, "0 or more (Pa)");
      has_deviation = true;
    } else if (keyword == "strength_floor") {
      settings_.strength.floor = arguments.number(keyword, not_negative, "0 or more (Pa)");
      has_floor = true;
    } else if (keyword == "shear_ratio") {
      settings_.shear_ratio = arguments.number(keyword, not_negative_or_infinite, "0 or more, or infinite");
    } else if (keyword == "seed") {
      const double seed = arguments.number(
          keyword, [](double s) { return s >= 0.0 && s < 9007199254740992.0 && s == std::floor(s); }, "a whole number from 0");
      settings_.strength.seed = static_cast<std::uint64_t>(seed);
      has_seed = true;
    } else if (keyword == "gap") {
      settings_.gap = arguments.number(keyword, not_negative, "0 or more (m)");
    } else if (keyword == "types") {
      read_types(arguments);
      has_types = true;
    } else if (keyword == "armed") {
      settings_.armed = arguments.yes_or_no(keyword);
      has_armed = true;
    } else {
      arguments.refuse("keyword", keyword,
                       "strength_mean, strength_sd, strength_floor, shear_ratio, seed, gap, types, armed");
    }
  }
  if (!has_armed) arguments.refuse("armed", "missing", "yes, no");
  if (settings_.armed) {
    if (!has_mean) arguments.refuse("strength_mean", "missing", "0 or more (Pa), or infinite");
    if (!has_deviation) arguments.refuse("strength_sd", "missing", "0 or more (Pa)");
    if (!has_seed) arguments.refuse("seed", "missing", "a whole number from 0");
    if (!has_types) arguments.refuse("types", "missing", "pairs of atom types, such as 1 1 3 3");
  }
  if (!has_floor && std::isfinite(settings_.strength.mean)) settings_.strength.floor = 0.1 * settings_.strength.mean;
  if (settings_.strength.floor > settings_.strength.mean)
    arguments.refuse("strength_floor", text_of(settings_.strength.floor), "0 to strength_mean (Pa)");
  state_.arming = settings_;

  restart_global = 1;
  scalar_flag = 1;
  vector_flag = 1;
  size_vector = 5;
  global_freq = 1;
  extscalar = 0;
  extvector = 0;
}

FixBondSettings::~FixBondSettings() { state_.arming = Arming{}; }

void FixBondSettings::read_types(Arguments &arguments)
{
  const std::string allowed = "pairs of atom types from 1 to " + std::to_string(atom->ntypes) + ", such as 1 1 3 3";
  const auto is_type = [this](double t) { return t >= 1.0 && t <= atom->ntypes && t == std::floor(t); };
  do {
    const int i = static_cast<int>(arguments.number("types", is_type, allowed));
    const int j = static_cast<int>(arguments.number("types", is_type, allowed));
    settings_.bondable[i * (settings_.types + 1) + j] = 1;
    settings_.bondable[j * (settings_.types + 1) + i] = 1;
  } while (arguments.number_follows());
}

int FixBondSettings::modify_param(int narg, char **arg)
{
  if (std::strcmp(arg[0], "armed") != 0) return 0;
  Arguments arguments(lmp, "fix_modify " + std::string(id), narg, arg, 1);
  const bool armed = arguments.yes_or_no("armed");
  if (armed && std::find(settings_.bondable.begin(), settings_.bondable.end(), 1) == settings_.bondable.end())
    arguments.fail("armed is yes, but the fix was defined without types and strengths; define it again with them");
  settings_.armed = armed;
  state_.arming = settings_;
  return arguments.position();
}

int FixBondSettings::setmask() { return LAMMPS_NS::FixConst::PRE_NEIGHBOR; }

void FixBondSettings::init()
{
  const std::string command = std::string("fix ") + id + " bond/settings";
  if (modify->n_fixes_style_strict(style) > 1) error->all(FLERR, (command + ": there is another fix bond/settings").c_str());
  auto *pair = dynamic_cast<LAMMPS_NS::PairGranProxy *>(force->pair);
  if (pair == nullptr || pair->get_history_offset("bond") < 0)
    error->all(FLERR, (command + ": needs 'pair_style gran model hooke/stiffness tangential bond'").c_str());
  check_gap();
}

// A gap beyond the reach of the neighbour list would leave out pairs without a word.
void FixBondSettings::check_gap() const
{
  double smallest = HUGE_VAL, radius = 0.0;
  for (int i = 0; i < atom->nlocal; ++i) smallest = std::min(smallest, atom->radius[i]);
  MPI_Allreduce(&smallest, &radius, 1, MPI_DOUBLE, MPI_MIN, world);
  const double reach = 2.0 * radius * state_.stretch_max;
  if (settings_.armed && settings_.gap > reach)
    error->all(FLERR, (std::string("fix ") + id + " bond/settings: gap is " + text_of(settings_.gap) +
                       ", allowed: 0 to " + text_of(reach) + " (m), the stretch_max " +
                       text_of(state_.stretch_max) + " of pair_style times the smallest grain's diameter").c_str());
}

// Neighbour lists are about to be built: the contact histories stand in the per-grain partner lists.
void FixBondSettings::pre_neighbor()
{
  const std::vector<BrokenPair> broken = gather_newly_broken();
  state_.newly_broken.clear();
  if (broken.empty()) return;
  for (const BrokenPair &pair : broken) state_.broken_pairs.insert(pair.key);
  align_copies(broken);
}

// Those of all ranks, on every rank.
std::vector<BrokenPair> FixBondSettings::gather_newly_broken() const
{
  const int mine = static_cast<int>(state_.newly_broken.size() * sizeof(BrokenPair));
  std::vector<int> bytes(comm->nprocs), starts(comm->nprocs, 0);
  MPI_Allgather(&mine, 1, MPI_INT, bytes.data(), 1, MPI_INT, world);
  for (int r = 1; r < comm->nprocs; ++r) starts[r] = starts[r - 1] + bytes[r - 1];
  std::vector<BrokenPair> all((starts.back() + bytes.back()) / sizeof(BrokenPair));
  if (!all.empty())
    MPI_Allgatherv(state_.newly_broken.data(), mine, MPI_BYTE, all.data(), bytes.data(), starts.data(), MPI_BYTE, world);
  return all;
}

// A contact across a periodic face is kept twice, with positions that differ in the last bit, so that
// one copy of a bond can break some steps before the other. After this, both are broken.
void FixBondSettings::align_copies(const std::vector<BrokenPair> &broken)
{
  std::unordered_map<std::uint64_t, const BrokenPair *> by_key;
  for (const BrokenPair &pair : broken) by_key[pair.key] = &pair;
  auto *style = static_cast<LAMMPS_NS::PairGranProxy *>(force->pair);
  LAMMPS_NS::FixContactHistory *histories = style->get_fix_history();
  const int offset = style->get_history_offset("bond");
  for (int i = 0; i < atom->nlocal; ++i) {
    for (int n = 0; n < histories->n_partner(i); ++n) {
      double *const history = histories->contacthistory(i, n) + offset;
      if (!is_bonded(history)) continue;
      const int partner = histories->partner(i, n);
      const auto found = by_key.find(pair_key(atom->tag[i], partner));
      if (found == by_key.end()) continue;
      set_bond_state(history, static_cast<laws::BondState>(found->second->state));
      if (atom->tag[i] < partner) state_.record_break(found->second->row);  // the counted copy
    }
  }
}

// -1 as long as there is no neighbour list.
double FixBondSettings::compute_scalar()
{
  const long here = count_intact_bonds(lmp);
  const double mine[2] = {static_cast<double>(here), here < 0 ? 1.0 : 0.0};
  double total[2];
  MPI_Allreduce(mine, total, 2, MPI_DOUBLE, MPI_SUM, world);
  return total[1] > 0.0 ? -1.0 : total[0];
}

double FixBondSettings::compute_vector(int column)
{
  if (column == 0) return compute_scalar();
  const BondCounts &c = state_.counts;
  const double mine[4] = {c.formed, c.at_floor, c.broken_in_tension, c.broken_in_shear};
  double total = 0.0;
  MPI_Allreduce(&mine[column - 1], &total, 1, MPI_DOUBLE, MPI_SUM, world);
  return total;
}

namespace {

template <class Item>
void write_items(FILE *file, const std::vector<Item> &items)
{
  const std::uint64_t number = items.size();
  fwrite(&number, sizeof number, 1, file);
  fwrite(items.data(), sizeof(Item), number, file);
}

template <class Item>
std::vector<Item> read_items(const char *&data)
{
  std::uint64_t number = 0;
  std::memcpy(&number, data, sizeof number);
  data += sizeof number;
  std::vector<Item> items(number);
  std::memcpy(items.data(), data, number * sizeof(Item));
  data += number * sizeof(Item);
  return items;
}

}  // namespace

void FixBondSettings::write_restart(FILE *file)
{
  std::vector<double> totals;
  for (int column = 1; column <= 4; ++column) totals.push_back(compute_vector(column));
  const std::vector<BrokenPair> pending = gather_newly_broken();
  if (comm->me != 0) return;
  const std::vector<std::uint64_t> keys(state_.broken_pairs.begin(), state_.broken_pairs.end());
  const std::size_t bytes = 3 * sizeof(std::uint64_t) + totals.size() * sizeof(double) +
                            keys.size() * sizeof(std::uint64_t) + pending.size() * sizeof(BrokenPair);
  const int header = static_cast<int>(bytes);
  fwrite(&header, sizeof header, 1, file);
  write_items(file, totals);
  write_items(file, keys);
  write_items(file, pending);
}

// Counts are sums over ranks and what is pending is to be told to all: the first rank takes them.
void FixBondSettings::restart(char *buffer)
{
  const char *data = buffer;
  const auto totals = read_items<double>(data);
  const auto keys = read_items<std::uint64_t>(data);
  const auto pending = read_items<BrokenPair>(data);
  const bool first = comm->me == 0;
  state_.counts = first ? BondCounts{totals[0], totals[1], totals[2], totals[3]} : BondCounts{};
  state_.broken_pairs = {keys.begin(), keys.end()};
  state_.newly_broken = first ? pending : std::vector<BrokenPair>{};
}

}  // namespace poreslip
