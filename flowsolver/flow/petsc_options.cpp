#include "flow/petsc_options.hpp"

#include <petscksp.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cstdarg>
#include <cstdio>
#include <optional>
#include <set>
#include <sstream>

#include "flow/petsc_check.hpp"

namespace poreslip::flow {
namespace {

// Of the linear solver's options; the latter are those of a solver without a prefix, of which there is none.
constexpr std::array<const char*, 4> prefixes{"flow_", "ksp_", "pc_", "mg_"};

// The tuned multigrid, unless the user's options say otherwise.
constexpr std::array<std::array<const char*, 2>, 13> default_options{{
    {"-flow_ksp_type", "cg"},
    {"-flow_ksp_norm_type", "unpreconditioned"},
    {"-flow_pc_type", "hypre"},
    {"-flow_pc_hypre_type", "boomeramg"},
    {"-flow_pc_hypre_boomeramg_coarsen_type", "PMIS"},
    {"-flow_pc_hypre_boomeramg_interp_type", "ext+i"},
    {"-flow_pc_hypre_boomeramg_P_max", "4"},
    {"-flow_pc_hypre_boomeramg_strong_threshold", "0.5"},
    {"-flow_pc_hypre_boomeramg_agg_nl", "1"},
    // Relaxing coarse and fine points in turn takes each sweep twice through the matrix and saves no iteration.
    {"-flow_pc_hypre_boomeramg_no_CF", "1"},
    // One way through the rows before the coarser level and the other way after it: symmetric together, at half the price of both ways twice,
    // for a fifth more iterations.
    // Scaled, for between ranks it is Jacobi's, which pores of two ranks with one short throat between them would spoil: of hydraulic-radius, 120
    // iterations on four ranks instead of 26.
    {"-flow_pc_hypre_boomeramg_relax_type_down", "l1-Gauss-Seidel"},
    {"-flow_pc_hypre_boomeramg_relax_type_up", "backward-l1-Gauss-Seidel"},
    // Where only differences of pressure are determined the coarsest level may come to a zero, as of one grain that touches its own image:
    // elimination fails there, and so does what divides by rows' sums.
    {"-flow_pc_hypre_boomeramg_relax_type_coarse", "Jacobi"},
}};

const std::string asked = "flow_help_";

// All that PETSc has said of its options so far: it says each thing once.
std::string help_text;

PetscErrorCode collect_list(FILE*, const char format[], va_list arguments) {
  std::vector<char> text(8192);
  const int result = PetscVSNPrintf(text.data(), text.size(), format, nullptr, arguments);
  help_text += text.data();
  return result;
}

PetscErrorCode collect(MPI_Comm, const char format[], ...) {
  va_list arguments;
  va_start(arguments, format);
  const PetscErrorCode result = collect_list(nullptr, format, arguments);
  va_end(arguments);
  return result;
}

// Without their dash.
std::vector<std::string> names_in(const std::string& given) {
  std::vector<std::string> names;
  std::istringstream words(given);
  for (std::string word; words >> word;)
    if (word.size() > 1 && word[0] == '-' && std::isalpha(static_cast<unsigned char>(word[1]))) names.push_back(word.substr(1));
  return names;
}

std::optional<std::string> in_use;

}  // namespace

void start_petsc() {
  PetscBool started = PETSC_FALSE;
  check(PetscInitialized(&started));
  if (!started) {
    check(PetscInitializeNoArguments());
    // The host program keeps its own signal handlers.
    check(PetscPopSignalHandler());
  }
  check(PetscPushErrorHandler(PetscReturnErrorHandler, nullptr));
}

void use_options(const std::string& given) {
  if (in_use == given) return;
  if (in_use)
    for (const std::string& name : names_in(*in_use)) check(PetscOptionsClearValue(nullptr, ("-" + name).c_str()));
  in_use = given;
  for (const auto& [name, value] : default_options) {
    // The environment may have set it.
    PetscBool set = PETSC_FALSE;
    check(PetscOptionsHasName(nullptr, nullptr, name, &set));
    if (!set) check(PetscOptionsSetValue(nullptr, name, value));
  }
  // What is given anew counts as used if it was.
  for (const std::string& name : names_in(given)) check(PetscOptionsClearValue(nullptr, ("-" + name).c_str()));
  check_options(PetscOptionsInsertString(nullptr, given.c_str()));
  // One relaxation that is given for all ways takes the place of both.
  const std::string relaxation = "flow_pc_hypre_boomeramg_relax_type_";
  const std::vector<std::string> names = names_in(given);
  const auto named = [&](const std::string& name) { return std::find(names.begin(), names.end(), relaxation + name) != names.end(); };
  for (const char* way : {"down", "up"})
    if (named("all") && !named(way)) check(PetscOptionsClearValue(nullptr, ("-" + relaxation + way).c_str()));
}

std::vector<std::string> unused_options(const std::string& given) {
  std::vector<std::string> unused;
  for (const std::string& name : names_in(given)) {
    PetscBool used = PETSC_FALSE;
    check(PetscOptionsUsed(nullptr, name.c_str(), &used));
    for (const char* prefix : prefixes)
      if (!used && name.rfind(prefix, 0) == 0) unused.push_back(name);
  }
  return unused;
}

std::vector<std::string> known_options() {
  // What PETSc would print for -help; lists of names go to the second printer.
  auto* const printer = PetscHelpPrintf;
  auto* const list_printer = PetscVFPrintf;
  PetscHelpPrintf = collect;
  PetscVFPrintf = collect_list;
  // A solver of the same types but of a name of its own, because it says nothing of one that has taken its options already.
  for (const char* type : {"ksp_type", "pc_type", "pc_hypre_type"}) {
    char value[64];
    PetscBool given = PETSC_FALSE;
    check(PetscOptionsGetString(nullptr, "flow_", (std::string("-") + type).c_str(), value, sizeof value, &given));
    if (given) check(PetscOptionsSetValue(nullptr, ("-" + asked + type).c_str(), value));
  }
  KSP solver = nullptr;
  check(PetscOptionsSetValue(nullptr, "-help", nullptr));
  check(KSPCreate(PETSC_COMM_SELF, &solver));
  check(KSPSetOptionsPrefix(solver, asked.c_str()));
  check(KSPSetFromOptions(solver));
  check(KSPDestroy(&solver));
  check(PetscOptionsClearValue(nullptr, "-help"));
  PetscHelpPrintf = printer;
  PetscVFPrintf = list_printer;
  std::set<std::string> known;
  std::istringstream words(help_text);
  for (std::string word; words >> word;)
    if (word.rfind("-" + asked, 0) == 0) known.insert("flow_" + word.substr(1 + asked.size(), word.find_first_of(":,") - 1 - asked.size()));
  return {known.begin(), known.end()};
}

}  // namespace poreslip::flow
