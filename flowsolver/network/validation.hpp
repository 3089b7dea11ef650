// Checks of what a caller hands over. Each message names what was given, what is allowed and what to do.
#pragma once

#include <mpi.h>

#include <string>
#include <vector>

#include "network/grain_input.hpp"
#include "geometry/view.hpp"
#include "tessellation/domain.hpp"

namespace poreslip {

// Message about the first fault, or empty.
std::string check_domain(const Domain& domain);
std::string check_grains(const GrainInput& input, const Domain& domain);

// Collective. Message about a grain id that occurs twice, on whichever ranks, or empty.
std::string check_unique_ids(MPI_Comm comm, const std::vector<std::int64_t>& id);

}  // namespace poreslip
