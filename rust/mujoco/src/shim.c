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

// The handler of one thread only: not in the public headers, but what MuJoCo's own bindings trap errors with. Its type
// is checked by use.
typedef void (*handler)(const oarlock_log*);
typedef handler (*set_handler)(handler);

// MuJoCo's functions, resolved from the library that is already in this process.
static struct {
#define DECLARE(name, result, parameters) result(*name) parameters;
  OARLOCK_FUNCTIONS(DECLARE)
#undef DECLARE
  set_handler set_thread_handler;
  oarlock_generic* control;
  oarlock_clock* time;
} api;

static const oarlock_layout LAYOUTS[] = {
#include "../layouts/table.h"
};

static const oarlock_field FIELDS[] = {
#define DESCRIBE(whole, field, type, name) {#whole, #field, #type},
    OARLOCK_FIELDS(DESCRIBE)
#undef DESCRIBE
};

enum { FIELD_COUNT = sizeof(FIELDS) / sizeof(*FIELDS), LAYOUT_COUNT = sizeof(LAYOUTS) / sizeof(*LAYOUTS), HEAD = 3 };
_Static_assert(sizeof(oarlock_layout) == (HEAD + FIELD_COUNT) * sizeof(uint32_t), "oarlock_layout");

static const oarlock_layout* layout_of(int version) {
  for (int i = 0; i < LAYOUT_COUNT; i++) {
    if ((int)LAYOUTS[i].version == version) return LAYOUTS + i;
  }
  return 0;
}

// That of the library that is open.
static oarlock_layout at;

// mjModel_nq(m) and its like: the place of a field in a struct.
#define ACCESS(whole, field, type, name)                               \
  static inline __typeof__(type)* whole##_##name(const whole* base) { \
    return (__typeof__(type)*)((char*)base + at.name);                 \
  }
OARLOCK_FIELDS(ACCESS)
#undef ACCESS

#define ENUM(name, number) name = (number),
enum { OARLOCK_ENUMS(ENUM) };
#undef ENUM

static _Thread_local jmp_buf trap;
static _Thread_local char* trapped;

// Comes back from an error by a jump to the call that it happened in: no frame but MuJoCo's lies between. Warnings are
// counted in mjData, where the harness reads them.
static void on_message(const oarlock_log* message) {
  if (message->level < OARLOCK_ERROR) return;
  snprintf(trapped, OARLOCK_MESSAGE, "%s", message->subject);
  longjmp(trap, 1);
}

// 0, or 1 with the text of MuJoCo's error in `message`.
#define TRAPPED(message, call)                                   \
  do {                                                           \
    const handler before = api.set_thread_handler(on_message);   \
    trapped = (message);                                         \
    const int failed = SETJMP(trap);                             \
    if (!failed) {                                               \
      call;                                                      \
    }                                                            \
    api.set_thread_handler(before);                              \
    return failed;                                               \
  } while (0)

// The versions that have a layout, oldest first; their number.
int oarlock_versions(int* versions, int room) {
  for (int i = 0; i < LAYOUT_COUNT && i < room; i++) versions[i] = (int)LAYOUTS[i].version;
  return LAYOUT_COUNT;
}

// The fields of a layout and their offsets; their number, 0 where the version has none.
int oarlock_describe(int version, const oarlock_field** fields, const uint32_t** offsets, int* contact_size,
                     int* eq_data_width) {
  const oarlock_layout* layout = layout_of(version);
  if (!layout) return 0;
  *fields = FIELDS;
  *offsets = (const uint32_t*)layout + HEAD;
  *contact_size = (int)layout->contact_size;
  *eq_data_width = (int)layout->eq_data_width;
  return FIELD_COUNT;
}

// 0: resolved; 1: the library at `path` is not in this process; 2: it lacks `missing`; 3: its `version` has no layout.
int oarlock_open(const char* path, int* version, const char** missing) {
  void* library = loaded(path);
  if (!library) return 1;
#define RESOLVE(name, result, parameters)                                   \
  api.name = (result(*) parameters)symbol(library, *missing = #name);       \
  if (!api.name) return 2;
  RESOLVE(mj_version, int, (void))
  *version = api.mj_version();
  const oarlock_layout* layout = layout_of(*version);
  if (!layout) return 3;
  at = *layout;
  OARLOCK_FUNCTIONS(RESOLVE)
#undef RESOLVE
  api.set_thread_handler = (set_handler)symbol(library, *missing = "_mjPRIVATE_setTlsLogHandler");
  if (!api.set_thread_handler) return 2;
  api.control = (oarlock_generic*)symbol(library, *missing = "mjcb_control");
  if (!api.control) return 2;
  api.time = (oarlock_clock*)symbol(library, *missing = "mjcb_time");
  return api.time ? 0 : 2;
}

int oarlock_copy_model(const mjModel* model, mjModel** copy, char* message) {
  TRAPPED(message, *copy = api.mj_copyModel(NULL, model));
}

void oarlock_leave_unsolved(mjModel* model, double timestep) {
  *mjModel_timestep(model) = timestep;
  *mjModel_jacobian(model) = mjJAC_AUTO;
  *mjModel_disableflags(model) |= mjDSBL_ISLAND;
}

// From timestep up to integrator an mjOption has numbers, from there up to disableactuator kinds, limits and switches.
size_t oarlock_options(const mjModel* m, void* room, size_t size) {
  const char* first = (const char*)mjModel_timestep(m);
  size_t length = (size_t)((const char*)(mjModel_disableflags(m) + 3) - first);
  if (length <= size) memcpy(room, first, length);
  return length;
}

void oarlock_make_dense(mjModel* model) { *mjModel_jacobian(model) = mjJAC_DENSE; }

void oarlock_delete_model(mjModel* model) { api.mj_deleteModel(model); }

int oarlock_make_data(const mjModel* model, mjData** data, char* message) {
  TRAPPED(message, *data = api.mj_makeData(model));
}

void oarlock_delete_data(mjData* data) { api.mj_deleteData(data); }

#define M(name) (*mjModel_##name(m))
#define D(name) (*mjData_##name(d))

void oarlock_view_model(const mjModel* m, oarlock_model* view) {
  const double* center = M(center);
  *view = (oarlock_model){
    .nq = M(nq), .nv = M(nv), .nu = M(nu), .na = M(na), .nbody = M(nbody), .njnt = M(njnt), .ngeom = M(ngeom),
    .nsite = M(nsite), .neq = M(neq), .ntendon = M(ntendon), .nwrap = M(nwrap), .nplugin = M(nplugin),
    .sparse = api.mj_isSparse(m), .staged = M(integrator) == mjINT_RK4, .eq_data_width = at.eq_data_width,
    .timestep = M(timestep),
    .mass_lengths = M(M_rownnz), .mass_starts = M(M_rowadr), .mass_columns = M(M_colind),
    .body_parentid = M(body_parentid), .body_rootid = M(body_rootid), .body_dofadr = M(body_dofadr),
    .body_dofnum = M(body_dofnum), .jnt_type = M(jnt_type), .jnt_qposadr = M(jnt_qposadr),
    .jnt_dofadr = M(jnt_dofadr), .geom_bodyid = M(geom_bodyid), .site_bodyid = M(site_bodyid),
    .eq_type = M(eq_type), .eq_objtype = M(eq_objtype), .eq_obj1id = M(eq_obj1id), .eq_obj2id = M(eq_obj2id),
    .tendon_adr = M(tendon_adr), .tendon_num = M(tendon_num), .wrap_type = M(wrap_type),
    .wrap_objid = M(wrap_objid), .qpos0 = M(qpos0), .geom_size = M(geom_size),
    .eq_data = M(eq_data), .eq_active0 = M(eq_active0), .tendon_length0 = M(tendon_length0), .wrap_prm = M(wrap_prm),
    .extent = M(extent), .center = {center[0], center[1], center[2]},
  };
}

// NULL where the element has no name.
const char* oarlock_name(const mjModel* m, int type, int id) { return api.mj_id2name(m, type, id); }

void oarlock_view_data(mjData* d, oarlock_data* view) {
  *view = (oarlock_data){
    .time = &D(time), .energy = D(energy), .qpos = D(qpos), .qvel = D(qvel), .act = D(act), .ctrl = D(ctrl),
    .qacc = D(qacc), .qfrc_constraint = D(qfrc_constraint), .eq_active = D(eq_active),
    .qfrc_smooth = D(qfrc_smooth), .qacc_smooth = D(qacc_smooth),
    .mass = D(M), .mass_factor = D(qLD), .inverse_diagonal = D(qLDiagInv), .cvel = D(cvel), .cdof_dot = D(cdof_dot),
    .subtree_com = D(subtree_com), .geom_xpos = D(geom_xpos), .geom_xmat = D(geom_xmat), .site_xpos = D(site_xpos),
    .ten_length = D(ten_length), .ten_velocity = D(ten_velocity), .wrap_xpos = D(wrap_xpos),
    .ten_wrapadr = D(ten_wrapadr), .ten_wrapnum = D(ten_wrapnum), .wrap_obj = D(wrap_obj),
    .solver_niter = D(solver_niter),
  };
}

void oarlock_view_rows(mjData* d, oarlock_rows* view) {
  *view = (oarlock_rows){
    .ne = D(ne), .nefc = D(nefc), .njacobian = D(nJ), .nisland = D(nisland), .id = D(efc_id),
    .rownnz = D(efc_J_rownnz), .rowadr = D(efc_J_rowadr), .colind = D(efc_J_colind), .jacobian = D(efc_J),
    .pos = D(efc_pos), .vel = D(efc_vel), .aref = D(efc_aref), .softness = D(efc_R),
    .law = D(efc_KBIP), .force = D(efc_force), .type = D(efc_type), .stiffness = D(efc_D),
    .friction_loss = D(efc_frictionloss),
  };
}

int oarlock_cone(const mjData* d, int contact, double* mu, double* friction) {
  const mjContact* c = (const mjContact*)((const char*)*mjData_contact(d) + (int64_t)contact * at.contact_size);
  *mu = *mjContact_contact_mu(c);
  memcpy(friction, *mjContact_contact_friction(c), 5 * sizeof(double));
  return *mjContact_contact_dim(c);
}

// The second half of mj_step.
static void integrate(const mjModel* m, mjData* d) {
  switch (M(integrator)) {
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
    case OARLOCK_SENSORS:
      api.mj_sensorPos(m, d);
      api.mj_sensorVel(m, d);
      api.mj_sensorAcc(m, d);
      break;
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

static oarlock_generic replaced;

static void on_control(const mjModel* m, mjData* d) {
  if (answering.control && answering.model == m) {
    answering.control(answering.self, D(time), D(ctrl));
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
static oarlock_clock clock_replaced;

static double no_clock(void) { return 0; }

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
