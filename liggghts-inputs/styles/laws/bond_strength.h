// Strength of one bond, drawn from a normal distribution by a counter-based hash of the two grain
// ids and a seed: the same bond has the same strength on any number of ranks, in any order, and
// nothing has to be stored or communicated to know it.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace poreslip::laws {

// Finaliser of splitmix64 (Steele, Lea & Flood 2014, OOPSLA): a bijection of 64-bit words.
inline std::uint64_t mix_bits(std::uint64_t word)
{
  word += 0x9e3779b97f4a7c15ULL;
  word = (word ^ (word >> 30)) * 0xbf58476d1ce4e5b9ULL;
  word = (word ^ (word >> 27)) * 0x94d049bb133111ebULL;
  return word ^ (word >> 31);
}

// Uniform in the open interval (0, 1): 53 bits, centred in their cell so that log() is finite.
inline double to_unit_interval(std::uint64_t word)
{
  return (static_cast<double>(word >> 11) + 0.5) * 0x1.0p-53;
}

// Standard normal number of the pair (id_i, id_j), symmetric in the ids (Box & Muller 1958).
inline double pair_normal(std::int64_t id_i, std::int64_t id_j, std::uint64_t seed)
{
  const auto [low, high] = std::minmax(id_i, id_j);
  const std::uint64_t key = mix_bits(
      mix_bits(mix_bits(seed) ^ static_cast<std::uint64_t>(low)) ^ static_cast<std::uint64_t>(high));
  const double u1 = to_unit_interval(mix_bits(key));
  const double u2 = to_unit_interval(mix_bits(key ^ 0xd1b54a32d192ed03ULL));
  constexpr double two_pi = 6.283185307179586476925286766559;
  return std::sqrt(-2.0 * std::log(u1)) * std::cos(two_pi * u2);
}

struct StrengthDistribution {
  double mean = 0.0;                // Pa; infinity means bonds that never break
  double standard_deviation = 0.0;  // Pa
  double floor = 0.0;               // Pa; a lower draw takes this value
  std::uint64_t seed = 0;
};

struct BondStrength {
  double stress;  // Pa
  bool at_floor;  // the draw was below the floor
};

inline BondStrength draw_strength(const StrengthDistribution &d, std::int64_t id_i, std::int64_t id_j)
{
  if (!std::isfinite(d.mean)) return {d.mean, false};
  const double drawn = d.mean + d.standard_deviation * pair_normal(id_i, id_j, d.seed);
  return drawn < d.floor ? BondStrength{d.floor, true} : BondStrength{drawn, false};
}

}  // namespace poreslip::laws
