// The two kinds of error. Both are raised on all ranks together.
#pragma once

#include <stdexcept>

namespace poreslip {

// Something given is wrong: the message names it, its value, what is allowed, and what to do.
struct InputError : std::invalid_argument {
  using std::invalid_argument::invalid_argument;
};

// The input was sound but the computation failed.
struct ComputationError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

}  // namespace poreslip
