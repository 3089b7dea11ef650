// Makes `pair_style gran model hooke/stiffness tangential bond` known to LIGGGHTS when this library is
// loaded, by way of LIGGGHTS' own factories.
#include <mpi.h>

#include "fix_insert_stream.h"
#include "contact_models.h"
#include "granular_pair_style.h"
#include "pair_gran_base.h"

namespace {

using namespace LIGGGHTS;
using namespace LIGGGHTS::ContactModels;

using BondStyle = GranStyle<HOOKE_STIFFNESS, TANGENTIAL_BOND, COHESION_OFF, ROLLING_OFF, SURFACE_DEFAULT>;

PairStyles::IGranularPairStyle *create(LAMMPS_NS::LAMMPS *lmp, LAMMPS_NS::PairGran *parent, std::int64_t hash)
{
  return new PairStyles::Granular<ContactModel<BondStyle>>(lmp, parent, hash);
}

const bool registered = [] {
  ContactModels::Factory::instance().addTangentialModel("bond", TANGENTIAL_BOND);
  PairStyles::Factory::instance().addStyle("gran", BondStyle::HASHCODE, &create);
  return true;
}();

}  // namespace
