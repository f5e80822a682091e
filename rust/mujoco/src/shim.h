// What library.rs sees of MuJoCo: pointers into mjModel and mjData, whose layout is a row of layouts/table.h, and calls that
// come back when MuJoCo reports an error.
#ifndef OARLOCK_SHIM_H_
#define OARLOCK_SHIM_H_

#include <stdint.h>

#include "../layouts/fields.h"
#include "../layouts/functions.h"

#define OARLOCK_MESSAGE 1024  // size of a buffer for a message

// Mirrored in library.rs, in this order.
typedef struct {
  int64_t nq, nv, nu, na, nbody, njnt, ngeom, nsite, neq, ntendon, nwrap, nplugin;
  int64_t sparse, staged, eq_data_width;
  double timestep;
  const int *mass_lengths, *mass_starts, *mass_columns;
  const int *body_parentid, *body_rootid, *body_dofadr, *body_dofnum, *jnt_type, *jnt_qposadr, *jnt_dofadr;
  const int *geom_bodyid, *site_bodyid, *eq_type, *eq_objtype, *eq_obj1id, *eq_obj2id;
  const int *tendon_adr, *tendon_num, *wrap_type, *wrap_objid;
  const _Bool* eq_active0;
  const double *qpos0, *geom_size, *eq_data, *tendon_length0, *wrap_prm;
  double extent, center[3];
} oarlock_model;

// The arrays of mjData that stay where they are.
typedef struct {
  double *time, *energy, *qpos, *qvel, *act, *ctrl, *qacc, *qfrc_constraint;
  _Bool* eq_active;
  const double *qfrc_smooth, *qacc_smooth, *mass, *mass_factor, *inverse_diagonal, *cvel, *cdof_dot;
  const double *subtree_com, *geom_xpos, *geom_xmat, *site_xpos, *ten_length, *ten_velocity, *wrap_xpos;
  const int *ten_wrapadr, *ten_wrapnum, *wrap_obj, *solver_niter;
} oarlock_data;

// The arrays in the arena: they move whenever the constraints are made anew.
typedef struct {
  int64_t ne, nefc, njacobian, nisland;
  const int *id, *rownnz, *rowadr, *colind;
  const double *jacobian, *pos, *vel, *aref, *softness, *law;
  double *force;
  const int *type;
  const double *stiffness, *friction_loss;
} oarlock_rows;

// Calls that take nothing but a model and its data; mirrored in library.rs.
enum {
  OARLOCK_FORWARD,
  OARLOCK_POSITION,
  OARLOCK_SMOOTH,      // position, velocity, actuation, acceleration: all but the constraint solver
  OARLOCK_RATES,       // the same without the position stage, which has been done
  OARLOCK_CONSTRAINT,
  OARLOCK_INTEGRATE,
  OARLOCK_ENERGY,
  OARLOCK_STEP,
  OARLOCK_SENSORS,     // all of them, at a state whose stages are done and whose forces are written
};

// Where one version of MuJoCo keeps what the shim reads: offsets in its structs, in the order of OARLOCK_FIELDS.
typedef struct {
  uint32_t version, eq_data_width, contact_size;
#define OARLOCK_OFFSET(whole, field, type, name) uint32_t name;
  OARLOCK_FIELDS(OARLOCK_OFFSET)
#undef OARLOCK_OFFSET
} oarlock_layout;

// A field of MuJoCo's structs, for those who check a layout; mirrored in library.rs.
typedef struct {
  const char *whole, *field, *type;
} oarlock_field;

// Writes ctrl at a time; mirrored in library.rs.
typedef void (*oarlock_control)(void* self, double time, double* ctrl);

#endif  // OARLOCK_SHIM_H_
