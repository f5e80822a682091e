#include "shim.h"

#include <setjmp.h>
#include <stdio.h>
#include <string.h>

#ifdef _WIN32
#include <windows.h>
#define SETJMP setjmp
static void* loaded(const char* path) { return (void*)GetModuleHandleA(path); }
static void* symbol(void* library, const char* name) { return (void*)GetProcAddress((HMODULE)library, name); }
#else
#include <dlfcn.h>
#define SETJMP _setjmp  // the one that does not save the signal mask
static void* loaded(const char* path) { return dlopen(path, RTLD_NOW | RTLD_NOLOAD); }
static void* symbol(void* library, const char* name) { return dlsym(library, name); }
#endif

// MuJoCo's functions, resolved from the library that is already in this process.
#define FUNCTIONS(X)                                                                                              \
  X(mj_copyModel) X(mj_deleteModel) X(mj_makeData) X(mj_deleteData) X(mj_isSparse) X(mj_version) X(mj_step)         \
  X(mj_forward) X(mj_fwdPosition) X(mj_fwdVelocity) X(mj_fwdActuation) X(mj_fwdAcceleration) X(mj_fwdConstraint)   \
  X(mj_RungeKutta) X(mj_Euler) X(mj_implicit) X(mj_energyPos) X(mj_energyVel) X(mj_solveM) X(mj_solveM2)            \
  X(mj_integratePos) X(mj_differentiatePos) X(mj_mulJacTVec) X(mj_mulM) X(mj_id2name)

// The handler of one thread only: not in the public headers, but what MuJoCo's own bindings trap errors with. Its type
// is checked by use; the library is of exactly the version of the headers.
typedef mjfLogHandler (*set_handler)(mjfLogHandler);

static struct {
#define DECLARE(name) __typeof__(&name) name;
  FUNCTIONS(DECLARE)
#undef DECLARE
  set_handler set_thread_handler;
  mjfGeneric* control;
  mjfTime* time;
} api;

static _Thread_local jmp_buf trap;
static _Thread_local char* trapped;

// Comes back from an error by a jump to the call that it happened in: no frame but MuJoCo's lies between. Warnings are
// counted in mjData, where the harness reads them.
static void on_message(const mjLogMessage* message) {
  if (message->level < mjLOG_ERROR) return;
  snprintf(trapped, OARLOCK_MESSAGE, "%s", message->subject);
  longjmp(trap, 1);
}

// 0, or 1 with the text of MuJoCo's error in `message`.
#define TRAPPED(message, call)                                   \
  do {                                                           \
    const mjfLogHandler before = api.set_thread_handler(on_message); \
    trapped = (message);                                         \
    const int failed = SETJMP(trap);                             \
    if (!failed) {                                               \
      call;                                                      \
    }                                                            \
    api.set_thread_handler(before);                              \
    return failed;                                               \
  } while (0)

int oarlock_header_version(void) { return mjVERSION_HEADER; }

// 0: resolved; 1: the library at `path` is not in this process; 2: it lacks `missing`; 3: it is of another `version`.
int oarlock_open(const char* path, int* version, const char** missing) {
  void* library = loaded(path);
  if (!library) return 1;
#define RESOLVE(name)                                                     \
  api.name = (__typeof__(api.name))symbol(library, *missing = #name);      \
  if (!api.name) return 2;
  RESOLVE(mj_version)
  *version = api.mj_version();
  if (*version != mjVERSION_HEADER) return 3;
  FUNCTIONS(RESOLVE)
#undef RESOLVE
  api.set_thread_handler = (set_handler)symbol(library, *missing = "_mjPRIVATE_setTlsLogHandler");
  if (!api.set_thread_handler) return 2;
  api.control = (mjfGeneric*)symbol(library, *missing = "mjcb_control");
  if (!api.control) return 2;
  api.time = (mjfTime*)symbol(library, *missing = "mjcb_time");
  return api.time ? 0 : 2;
}

int oarlock_copy_model(const mjModel* model, mjModel** copy, char* message) {
  TRAPPED(message, *copy = api.mj_copyModel(NULL, model));
}

void oarlock_leave_unsolved(mjModel* model, double timestep) {
  model->opt.timestep = timestep;
  model->opt.jacobian = mjJAC_AUTO;
  model->opt.disableflags |= mjDSBL_ISLAND;
}

void oarlock_delete_model(mjModel* model) { api.mj_deleteModel(model); }

int oarlock_make_data(const mjModel* model, mjData** data, char* message) {
  TRAPPED(message, *data = api.mj_makeData(model));
}

void oarlock_delete_data(mjData* data) { api.mj_deleteData(data); }

void oarlock_view_model(const mjModel* m, oarlock_model* view) {
  *view = (oarlock_model){
    .nq = m->nq, .nv = m->nv, .nu = m->nu, .na = m->na, .nbody = m->nbody, .njnt = m->njnt, .ngeom = m->ngeom,
    .nsite = m->nsite, .neq = m->neq, .ntendon = m->ntendon, .nwrap = m->nwrap, .nplugin = m->nplugin,
    .sparse = api.mj_isSparse(m), .staged = m->opt.integrator == mjINT_RK4, .timestep = m->opt.timestep,
    .mass_lengths = m->M_rownnz, .mass_starts = m->M_rowadr, .mass_columns = m->M_colind,
    .body_parentid = m->body_parentid, .body_rootid = m->body_rootid, .body_dofadr = m->body_dofadr,
    .body_dofnum = m->body_dofnum, .jnt_type = m->jnt_type, .jnt_qposadr = m->jnt_qposadr,
    .jnt_dofadr = m->jnt_dofadr, .geom_bodyid = m->geom_bodyid, .site_bodyid = m->site_bodyid,
    .eq_type = m->eq_type, .eq_objtype = m->eq_objtype, .eq_obj1id = m->eq_obj1id, .eq_obj2id = m->eq_obj2id,
    .tendon_adr = m->tendon_adr, .tendon_num = m->tendon_num, .wrap_type = m->wrap_type,
    .wrap_objid = m->wrap_objid, .qpos0 = m->qpos0, .geom_size = m->geom_size,
    .eq_data = m->eq_data, .eq_active0 = m->eq_active0, .tendon_length0 = m->tendon_length0, .wrap_prm = m->wrap_prm,
    .extent = m->stat.extent, .center = {m->stat.center[0], m->stat.center[1], m->stat.center[2]},
  };
}

// NULL where the element has no name.
const char* oarlock_name(const mjModel* m, int type, int id) { return api.mj_id2name(m, type, id); }

void oarlock_view_data(mjData* d, oarlock_data* view) {
  *view = (oarlock_data){
    .time = &d->time, .energy = d->energy, .qpos = d->qpos, .qvel = d->qvel, .act = d->act, .ctrl = d->ctrl,
    .qacc = d->qacc, .qfrc_constraint = d->qfrc_constraint, .eq_active = d->eq_active, .qfrc_smooth = d->qfrc_smooth, .qacc_smooth = d->qacc_smooth,
    .mass = d->M, .mass_factor = d->qLD, .inverse_diagonal = d->qLDiagInv, .cvel = d->cvel, .cdof_dot = d->cdof_dot,
    .subtree_com = d->subtree_com, .geom_xpos = d->geom_xpos, .geom_xmat = d->geom_xmat, .site_xpos = d->site_xpos,
    .ten_length = d->ten_length, .ten_velocity = d->ten_velocity, .wrap_xpos = d->wrap_xpos,
    .ten_wrapadr = d->ten_wrapadr, .ten_wrapnum = d->ten_wrapnum, .wrap_obj = d->wrap_obj,
    .solver_niter = d->solver_niter,
  };
}

void oarlock_view_rows(mjData* d, oarlock_rows* view) {
  *view = (oarlock_rows){
    .ne = d->ne, .nefc = d->nefc, .njacobian = d->nJ, .nisland = d->nisland, .id = d->efc_id,
    .rownnz = d->efc_J_rownnz, .rowadr = d->efc_J_rowadr, .colind = d->efc_J_colind, .jacobian = d->efc_J,
    .pos = d->efc_pos, .vel = d->efc_vel, .aref = d->efc_aref, .softness = d->efc_R,
    .law = d->efc_KBIP, .force = d->efc_force, .type = d->efc_type, .stiffness = d->efc_D,
    .friction_loss = d->efc_frictionloss,
  };
}

int oarlock_cone(const mjData* d, int contact, double* mu, double* friction) {
  const mjContact* c = d->contact + contact;
  *mu = c->mu;
  memcpy(friction, c->friction, 5 * sizeof(double));
  return c->dim;
}

// The second half of mj_step.
static void integrate(const mjModel* m, mjData* d) {
  switch (m->opt.integrator) {
    case mjINT_RK4: api.mj_RungeKutta(m, d, 4); break;
    case mjINT_EULER: api.mj_Euler(m, d); break;
    default: api.mj_implicit(m, d); break;
  }
}

static void run(int stage, const mjModel* m, mjData* d) {
  switch (stage) {
    case OARLOCK_FORWARD: api.mj_forward(m, d); break;
    case OARLOCK_POSITION: api.mj_fwdPosition(m, d); break;
    case OARLOCK_SMOOTH:
      api.mj_fwdPosition(m, d);
      // fallthrough
    case OARLOCK_RATES:
      api.mj_fwdVelocity(m, d);
      api.mj_fwdActuation(m, d);
      api.mj_fwdAcceleration(m, d);
      break;
    case OARLOCK_CONSTRAINT: api.mj_fwdConstraint(m, d); break;
    case OARLOCK_INTEGRATE: integrate(m, d); break;
    case OARLOCK_ENERGY:
      api.mj_energyPos(m, d);
      api.mj_energyVel(m, d);
      break;
    case OARLOCK_STEP: api.mj_step(m, d); break;
    default: break;
  }
}

int oarlock_run(int stage, const mjModel* m, mjData* d, char* message) { TRAPPED(message, run(stage, m, d)); }

// x = H y for `count` vectors of nv, M⁻¹ = Hᵀ H; `roots` are 1/√D of the factor, nv.
int oarlock_whiten(const mjModel* m, mjData* d, int count, double* x, const double* y, const double* roots,
                   char* message) {
  TRAPPED(message, api.mj_solveM2(m, d, x, y, roots, count));
}

// x = M⁻¹ y, both nv.
int oarlock_solve_mass(const mjModel* m, mjData* d, double* x, const double* y, char* message) {
  TRAPPED(message, api.mj_solveM(m, d, x, y, 1));
}

// y = M x, both nv.
int oarlock_multiply_mass(const mjModel* m, const mjData* d, double* y, const double* x, char* message) {
  TRAPPED(message, api.mj_mulM(m, d, y, x));
}

// y = Jᵀ x, nv of nefc.
int oarlock_jacobian_transposed_times(const mjModel* m, const mjData* d, const double* x, double* y, char* message) {
  TRAPPED(message, api.mj_mulJacTVec(m, d, y, x));
}

void oarlock_integrate(const mjModel* m, double* qpos, const double* qvel, double dt) {
  api.mj_integratePos(m, qpos, qvel, dt);
}

void oarlock_differentiate(const mjModel* m, double* qvel, const double* qpos1, const double* qpos2) {
  api.mj_differentiatePos(m, qvel, 1.0, qpos1, qpos2);
}

// The control hook. It is one for the process; each thread says for itself who answers.
static _Thread_local struct {
  const mjModel* model;
  oarlock_control control;
  void* self;
} answering;

static mjfGeneric replaced;

static void on_control(const mjModel* m, mjData* d) {
  if (answering.control && answering.model == m) {
    answering.control(answering.self, d->time, d->ctrl);
  } else if (replaced) {
    replaced(m, d);
  }
}

// The caller sees to it that calls of these two alternate.
void oarlock_hook(void) {
  replaced = *api.control;
  *api.control = on_control;
}

void oarlock_unhook(void) { *api.control = replaced; }

// What MuJoCo's timers ask: a clock costs more than a stage of a small model. It is replaced, never cleared: other threads
// may be between asking whether there is one and calling it.
static mjfTime clock_replaced;

static mjtNum no_clock(void) { return 0; }

// The caller sees to it that calls of these two alternate.
void oarlock_stop_timers(void) {
  clock_replaced = *api.time;
  if (clock_replaced) *api.time = no_clock;
}

void oarlock_start_timers(void) {
  if (*api.time == no_clock) *api.time = clock_replaced;
}

void oarlock_answer(const mjModel* model, oarlock_control control, void* self) {
  answering.model = model;
  answering.control = control;
  answering.self = self;
}
