/* C interface of libporeslip_liggghts.so. `lmp` is the pointer that lammps_open gave. Functions that
   return a number of rows write at most `capacity` rows and return how many there are; call them with
   capacity 0 to learn it. Nothing here communicates between ranks. */
#ifndef PORESLIP_STYLES_H
#define PORESLIP_STYLES_H

#ifdef __cplusplus
extern "C" {
#endif

/* Registers the fixes bond/settings, wall/plane, damping/local and poreforce. Once after each
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

/* Contacts counted on this rank, out[capacity][13]: id_i, id_j (id_i < id_j), type_i, type_j, bonded (0 or
   1), F_n (N, compression > 0), F_s x, y, z on grain id_i (N), overlap (m), contact point x, y, z (m). Spring
   forces, without damping. Returns the number of contacts, -1 before the first run or after grains were
   deleted. Valid right after a run. */
int poreslip_contacts(void *lmp, double *out, int capacity);

/* fix wall/plane: the fluid's force on the plane (N, positive when it pushes the plane away from the
   grains); stays until changed. To be given alike on all ranks. Returns 0, or -1 if there is no such fix. */
int poreslip_wall_set_fluid_force(void *lmp, const char *fix_id, double force);

/* out[7]: position (m), velocity of the position (m/s), contact force (N), fluid force (N), number of contacts,
   work done on the grains (J), steps at which the servo's speed was limited. Returns 0, or -1. */
int poreslip_wall_state(void *lmp, const char *fix_id, double *out);

#ifdef __cplusplus
}
#endif

#endif
