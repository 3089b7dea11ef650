// Turns the errors of LIGGGHTS into return codes.
//
// LIGGGHTS ends the process (MPI_Finalize, exit) at each error, so that a program that has it as a library never regains
// control. This shared object defines the members of its Error class anew: loaded with RTLD_GLOBAL before libliggghts, its
// definitions are the ones that the dynamic linker binds, and they throw. The entry points below catch and hand the message
// over. After an error the engine must not be used again, closing included.
#include <mpi.h>

#include <lammps.h>

#include <compute.h>
#include <error.h>
#include <fix.h>
#include <group.h>
#include <input.h>
#include <library.h>
#include <modify.h>

#include <cstdio>
#include <stdexcept>
#include <string>

namespace {

// Where an engine error was raised: on all ranks together, or on one of them while the others go on.
enum Status { ok = 0, raised_on_all = 1, raised_on_one = 2 };

struct EngineError : std::runtime_error {
  EngineError(Status where, const std::string &message) : std::runtime_error(message), status(where) {}
  Status status;
};

// The command that was being carried out. Input keeps its buffers protected; a derived view may name them.
struct InputView : LAMMPS_NS::Input {
  static std::string command_of(LAMMPS_NS::Input *input) {
    const char *line = input->*(&InputView::line);
    std::string text = line ? line : "";
    while (!text.empty() && (text.back() == '\n' || text.back() == ' ')) text.pop_back();
    return text;
  }
};

void copy_message(const std::string &text, char *message, int size) {
  std::snprintf(message, static_cast<std::size_t>(size), "%s", text.c_str());
}

template <typename Call>
int guarded(void *engine, char *message, int size, Call &&call) {
  auto *lmp = static_cast<LAMMPS_NS::LAMMPS *>(engine);
  try {
    call();
    return ok;
  } catch (const EngineError &error) {
    std::string text = error.what();
    if (lmp) {
      if (lmp->logfile) {
        std::fprintf(lmp->logfile, "ERROR: %s\n", error.what());
        std::fflush(lmp->logfile);
      }
      const std::string command = InputView::command_of(lmp->input);
      if (!command.empty()) text += "\n  at the command: " + command;
    }
    copy_message(text, message, size);
    return error.status;
  } catch (const std::exception &error) {
    copy_message(error.what(), message, size);
    return raised_on_one;
  }
}

}  // namespace

namespace LAMMPS_NS {

void Error::all(const char *, int, const char *text) { throw EngineError(raised_on_all, text); }
void Error::one(const char *, int, const char *text) { throw EngineError(raised_on_one, text); }
// The command `quit` of a deck.
void Error::done() { throw EngineError(raised_on_all, "the deck ends the engine, which the driver still needs: take the command out"); }
void Error::cg(const char *, int, const char *text) {
  throw EngineError(raised_on_all, std::string("not allowed with coarse-graining: ") + text);
}
void Error::fix_error(const char *, int, Fix *fix, const char *text) {
  throw EngineError(raised_on_all, std::string("fix ") + fix->style + " (id " + fix->id + "): " + text);
}
void Error::fix_error(const char *, int, Fix *fix, const char *style, const char *text) {
  throw EngineError(raised_on_all, std::string("fix ") + style + " (id " + fix->id + "): " + text);
}
void Error::compute_error(const char *, int, Compute *compute, const char *text) {
  throw EngineError(raised_on_all, std::string("compute ") + compute->style + " (id " + compute->id + "): " + text);
}

}  // namespace LAMMPS_NS

extern "C" {

int poreslip_engine_open(int argc, char **argv, MPI_Comm communicator, void **engine, char *message, int size) {
  return guarded(nullptr, message, size, [&] { lammps_open(argc, argv, communicator, engine); });
}

int poreslip_engine_file(void *engine, const char *path, char *message, int size) {
  return guarded(engine, message, size, [&] { lammps_file(engine, path); });
}

int poreslip_engine_command(void *engine, const char *line, char *message, int size) {
  return guarded(engine, message, size, [&] { lammps_command(engine, line); });
}

// A variable is evaluated when it is read, and can fail then.
int poreslip_engine_variable(void *engine, const char *name, double *value, char *message, int size) {
  return guarded(engine, message, size, [&] {
    auto *found = static_cast<double *>(lammps_extract_variable(engine, const_cast<char *>(name), nullptr));
    if (!found) throw EngineError(raised_on_all, std::string("the deck defines no equal-style variable ") + name);
    *value = *found;
    lammps_free(found);
  });
}

// Bit of a group in the grains' mask, 0 where the deck defines no such group.
int poreslip_engine_group_bit(void *engine, const char *name) {
  LAMMPS_NS::Group *groups = static_cast<LAMMPS_NS::LAMMPS *>(engine)->group;
  const int index = groups->find(name);
  return index < 0 ? 0 : groups->bitmask[index];
}

// Bits of the groups whose motion some fix integrates.
int poreslip_engine_moved_groups(void *engine) {
  const LAMMPS_NS::Modify *modify = static_cast<LAMMPS_NS::LAMMPS *>(engine)->modify;
  int bits = 0;
  for (int i = 0; i < modify->nfix; ++i)
    if (modify->fix[i]->time_integrate) bits |= modify->fix[i]->groupbit;
  return bits;
}

// Ids and styles, a line each, of the fixes that take part in the steps themselves, not only after them.
void poreslip_engine_acting_fixes(void *engine, char *names, int size) {
  namespace FixConst = LAMMPS_NS::FixConst;
  const LAMMPS_NS::Modify *modify = static_cast<LAMMPS_NS::LAMMPS *>(engine)->modify;
  const int acts = FixConst::INITIAL_INTEGRATE | FixConst::POST_INTEGRATE | FixConst::PRE_FORCE | FixConst::POST_FORCE | FixConst::FINAL_INTEGRATE;
  std::string text;
  for (int i = 0; i < modify->nfix; ++i)
    if (modify->fmask[i] & acts) text += std::string(modify->fix[i]->id) + " " + modify->fix[i]->style + "\n";
  copy_message(text, names, size);
}

// Whether there is a fix of this id.
int poreslip_engine_has_fix(void *engine, const char *id) {
  return static_cast<LAMMPS_NS::LAMMPS *>(engine)->modify->find_fix(id) >= 0;
}

int poreslip_engine_close(void *engine, char *message, int size) {
  return guarded(nullptr, message, size, [&] { lammps_close(engine); });
}

}
