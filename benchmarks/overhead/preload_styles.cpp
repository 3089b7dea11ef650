// Gives the stock `liggghts` our styles, so that it can run the same decks: preloaded together with libporeslip_liggghts.so,
// this definition of Input::file() is the one that its main() calls.
#include <mpi.h>

#include <input.h>
#include <lammps.h>

#include <dlfcn.h>

extern "C" void poreslip_register_styles(void *lmp);

namespace {

struct InputView : LAMMPS_NS::Input {
  static LAMMPS_NS::LAMMPS *engine_of(LAMMPS_NS::Input *input) { return input->*(&InputView::lmp); }
};

}  // namespace

void LAMMPS_NS::Input::file()
{
  poreslip_register_styles(InputView::engine_of(this));
  using File = void (*)(Input *);
  reinterpret_cast<File>(dlsym(RTLD_NEXT, "_ZN9LAMMPS_NS5Input4fileEv"))(this);
}
