// MuJoCo's functions that the shim calls: name, result, parameters. probe.c compares them with the headers of a version.
#ifndef OARLOCK_FUNCTIONS_H_
#define OARLOCK_FUNCTIONS_H_

// As in MuJoCo's headers; nothing but pointers to them is used.
typedef struct mjModel_ mjModel;
typedef struct mjData_ mjData;
typedef struct mjContact_ mjContact;

#define OARLOCK_FUNCTIONS(X)                                                                      \
  X(mj_copyModel, mjModel*, (mjModel*, const mjModel*))                                           \
  X(mj_deleteModel, void, (mjModel*))                                                             \
  X(mj_makeData, mjData*, (const mjModel*))                                                       \
  X(mj_deleteData, void, (mjData*))                                                               \
  X(mj_isSparse, int, (const mjModel*))                                                           \
  X(mj_version, int, (void))                                                                      \
  X(mj_step, void, (const mjModel*, mjData*))                                                     \
  X(mj_forward, void, (const mjModel*, mjData*))                                                  \
  X(mj_fwdPosition, void, (const mjModel*, mjData*))                                              \
  X(mj_fwdVelocity, void, (const mjModel*, mjData*))                                              \
  X(mj_fwdActuation, void, (const mjModel*, mjData*))                                             \
  X(mj_fwdAcceleration, void, (const mjModel*, mjData*))                                          \
  X(mj_fwdConstraint, void, (const mjModel*, mjData*))                                            \
  X(mj_RungeKutta, void, (const mjModel*, mjData*, int))                                          \
  X(mj_Euler, void, (const mjModel*, mjData*))                                                    \
  X(mj_implicit, void, (const mjModel*, mjData*))                                                 \
  X(mj_sensorPos, void, (const mjModel*, mjData*))                                                \
  X(mj_sensorVel, void, (const mjModel*, mjData*))                                                \
  X(mj_sensorAcc, void, (const mjModel*, mjData*))                                                \
  X(mj_energyPos, void, (const mjModel*, mjData*))                                                \
  X(mj_energyVel, void, (const mjModel*, mjData*))                                                \
  X(mj_solveM, void, (const mjModel*, mjData*, double*, const double*, int))                      \
  X(mj_solveM2, void, (const mjModel*, mjData*, double*, const double*, const double*, int))      \
  X(mj_integratePos, void, (const mjModel*, double*, const double*, double))                      \
  X(mj_differentiatePos, void, (const mjModel*, double*, double, const double*, const double*))   \
  X(mj_mulJacTVec, void, (const mjModel*, const mjData*, double*, const double*))                 \
  X(mj_mulM, void, (const mjModel*, const mjData*, double*, const double*))                       \
  X(mj_id2name, const char*, (const mjModel*, int, int))

// Hooks: the type of what they hold.
typedef void (*oarlock_generic)(const mjModel*, mjData*);
typedef double (*oarlock_clock)(void);

// The start of mjLogMessage, and the level from which a message is an error.
typedef struct {
  int level, topic;
  char subject[1024];
} oarlock_log;
#define OARLOCK_ERROR 3

// The numbers of enumerations that the shim and the Rust code use.
#define OARLOCK_ENUMS(X)                                                                                    \
  X(mjINT_EULER, 0) X(mjINT_RK4, 1) X(mjJAC_DENSE, 0) X(mjJAC_AUTO, 2) X(mjDSBL_ISLAND, 1 << 18)                               \
  X(mjOBJ_GEOM, 5) X(mjOBJ_SITE, 6) X(mjOBJ_EQUALITY, 17) X(mjOBJ_TENDON, 18)                                \
  X(mjEQ_CONNECT, 0) X(mjEQ_WELD, 1) X(mjEQ_JOINT, 2) X(mjEQ_TENDON, 3)                                      \
  X(mjCNSTR_EQUALITY, 0) X(mjCNSTR_FRICTION_DOF, 1) X(mjCNSTR_FRICTION_TENDON, 2) X(mjCNSTR_LIMIT_JOINT, 3)  \
  X(mjCNSTR_LIMIT_TENDON, 4) X(mjCNSTR_CONTACT_ELLIPTIC, 7)                                                  \
  X(mjWRAP_JOINT, 1) X(mjWRAP_PULLEY, 2) X(mjWRAP_SITE, 3) X(mjWRAP_SPHERE, 4) X(mjWRAP_CYLINDER, 5)         \
  X(mjJNT_FREE, 0) X(mjJNT_BALL, 1) X(mjJNT_SLIDE, 2) X(mjJNT_HINGE, 3)

#endif  // OARLOCK_FUNCTIONS_H_
