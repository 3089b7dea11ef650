// The contacts of this rank, read from the neighbour list and the contact history.
#pragma once

#include <array>
#include <vector>

namespace LAMMPS_NS {
class LAMMPS;
}

namespace poreslip {

// Spring forces; normal: compression > 0, shear: on grain id_i. id_i < id_j.
enum ContactColumn { contact_id_i, contact_id_j, contact_type_i, contact_type_j, contact_bonded,
                     contact_normal_force, contact_shear_x, contact_shear_y, contact_shear_z, contact_overlap,
                     contact_x, contact_y, contact_z, contact_energy, contact_columns };
using ContactRow = std::array<double, contact_columns>;

// Whether the contacts are of a model whose forces can be read here: linear springs, with a tangential history or bonds.
bool contacts_are_linear(LAMMPS_NS::LAMMPS *lmp);

// Contacts (overlap > 0, or bonded) counted on this rank: each is counted on one rank, the owner of the
// grain of lower id. False if there is no neighbour list of the present grains: before the first run,
// or after grains were deleted.
bool collect_contacts(LAMMPS_NS::LAMMPS *lmp, std::vector<ContactRow> &rows);

// Intact bonds counted on this rank by the same rule; -1 without a neighbour list or without the bond style.
long count_intact_bonds(LAMMPS_NS::LAMMPS *lmp);

}  // namespace poreslip
