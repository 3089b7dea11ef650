/* C interface of libporeslip_liggghts.so. `lmp` is the pointer that lammps_open gave. Functions that
   return a number of rows write at most `capacity` rows and return how many there are; call them with
   capacity 0 to learn it. Nothing here communicates between ranks. */
#ifndef PORESLIP_STYLES_H
#define PORESLIP_STYLES_H

#ifdef __cplusplus
extern "C" {
#endif

/* Registers the fixes bond/settings, wall/plane, damping/local, poreforce and poreforce/two_way. Once after each
   lammps_open; further calls do nothing. The contact model is known as soon as the library is loaded. */
void poreslip_register_styles(void *lmp);

/* Breaks on record on this rank since they were last taken. */
int poreslip_break_count(void *lmp);

/* Moves the oldest breaks into out[capacity][10]: step, id_i, id_j (id_i < id_j), mode (1 tension,
   2 shear), x, y, z (m), F_n (N, compression > 0), F_s (N), elastic energy released (J). Returns the
   number of rows moved. */
int poreslip_take_breaks(void *lmp, double *out, int capacity);

void poreslip_clear_breaks(void *lmp);

/* Intact bonds counted on this rank; -1 before the first run or without tangential bond. */
long poreslip_count_bonds(void *lmp);

/* Contacts counted on this rank, out[capacity][14]: id_i, id_j (id_i < id_j), type_i, type_j, bonded (0 or
   1), F_n (N, compression > 0), F_s x, y, z on grain id_i (N), overlap (m), contact point x, y, z (m), elastic
   energy (J). Spring forces, without damping. Returns the number of contacts, -1 before the first run or after grains
   were deleted, -2 if the contact model is none of linear springs with a tangential history or bonds. Valid right after a run. */
int poreslip_contacts(void *lmp, double *out, int capacity);

/* fix wall/plane: the fluid's force on the plane (N, positive when it pushes the plane away from the
   grains); stays until changed. To be given alike on all ranks. Returns 0, or -1 if there is no such fix. */
int poreslip_wall_set_fluid_force(void *lmp, const char *fix_id, double force);

/* out[7]: position (m), velocity of the position (m/s), contact force (N), fluid force (N), number of contacts,
   work done on the grains (J), steps at which the servo's speed was limited. Returns 0, or -1. */
int poreslip_wall_state(void *lmp, const char *fix_id, double *out);

/* A pore fluid's answer to one step of the engine. `grains` of this rank, in any order, moved at velocity[grains][3] (m/s) over
   dt (s), and the planes at plane_velocity[groups][6] (m/s, outward; x low, x high, ... z high, for each group of grains). In:
   the forces before the step; out: after it, force[grains][3] (N), and on the planes plane_force[groups][6] (N, outward, over all
   ranks). Called on all ranks together. Returns NULL, or what went wrong, on all ranks. */
typedef const char *(*poreslip_fluid_step)(void *fluid, double dt, int grains, const int *id, const double *velocity,
                                           const double *plane_velocity, double *force, double *plane_force);

/* Gives a fix poreforce/two_way its fluid. Plane w, a fix wall/plane of id plane_id[w], stands on face[w] for the groups of grains
   whose bits are set in parts[w]. Returns 0, -1 if there is no such fix poreforce/two_way, or -2 if a plane is missing. */
int poreslip_couple_fluid(void *lmp, const char *fix_id, poreslip_fluid_step step, void *fluid, int groups, int planes,
                          const char *const *plane_id, const int *face, const int *parts);

#ifdef __cplusplus
}
#endif

#endif
