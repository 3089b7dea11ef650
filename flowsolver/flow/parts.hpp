// Parts of the pore space that no open throat joins.
#pragma once

#include <cstdint>
#include <vector>

#include "flow/conductance.hpp"
#include "network/pore_network.hpp"

namespace poreslip::flow {

// Collective. For each local pore the number of its part, alike on all ranks; numbers have gaps.
std::vector<std::int64_t> connected_parts(PoreNetwork& network, const Throats& throats);

// Collective. fixed (pores): 1 where the pressure is given. Fixes the pores of the parts without any such pore too, and returns how many of them
// there are, over all ranks.
std::int64_t fix_cut_off(PoreNetwork& network, const std::vector<std::int64_t>& part, std::vector<std::uint8_t>& fixed);

// Collective. The same for the pores without any open throat.
std::int64_t fix_isolated(PoreNetwork& network, const Throats& throats, std::vector<std::uint8_t>& fixed);

// Collective. Throws InputError on all ranks if the pores that are not fixed are of several parts.
void refuse_several(PoreNetwork& network, const std::vector<std::int64_t>& part, const std::vector<std::uint8_t>& fixed);

}  // namespace poreslip::flow
