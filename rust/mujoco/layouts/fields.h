// What of MuJoCo's structs the shim reads or writes: struct, field, its type, and the name of its offset in a layout.
//
// shim.h makes the struct of a layout and typed access from this list, probe.c the numbers of one version.
#ifndef OARLOCK_FIELDS_H_
#define OARLOCK_FIELDS_H_

// In order of the structs, so that a row of table.h rises from left to right.
#define OARLOCK_FIELDS(X)                                                                                          \
  X(mjModel, nq, int64_t, nq)                                                                                      \
  X(mjModel, nv, int64_t, nv)                                                                                      \
  X(mjModel, nu, int64_t, nu)                                                                                      \
  X(mjModel, na, int64_t, na)                                                                                      \
  X(mjModel, nbody, int64_t, nbody)                                                                                \
  X(mjModel, njnt, int64_t, njnt)                                                                                  \
  X(mjModel, ngeom, int64_t, ngeom)                                                                                \
  X(mjModel, nsite, int64_t, nsite)                                                                                \
  X(mjModel, neq, int64_t, neq)                                                                                    \
  X(mjModel, ntendon, int64_t, ntendon)                                                                            \
  X(mjModel, nwrap, int64_t, nwrap)                                                                                \
  X(mjModel, nplugin, int64_t, nplugin)                                                                            \
  X(mjModel, opt.timestep, double, timestep)                                                                       \
  X(mjModel, opt.integrator, int, integrator)                                                                      \
  X(mjModel, opt.jacobian, int, jacobian)                                                                          \
  X(mjModel, opt.disableflags, int, disableflags)                                                                  \
  X(mjModel, stat.extent, double, extent)                                                                          \
  X(mjModel, stat.center, double[3], center)                                                                       \
  X(mjModel, qpos0, double*, qpos0)                                                                                \
  X(mjModel, body_parentid, int*, body_parentid)                                                                   \
  X(mjModel, body_rootid, int*, body_rootid)                                                                       \
  X(mjModel, body_dofnum, int*, body_dofnum)                                                                       \
  X(mjModel, body_dofadr, int*, body_dofadr)                                                                       \
  X(mjModel, jnt_type, int*, jnt_type)                                                                             \
  X(mjModel, jnt_qposadr, int*, jnt_qposadr)                                                                       \
  X(mjModel, jnt_dofadr, int*, jnt_dofadr)                                                                         \
  X(mjModel, geom_bodyid, int*, geom_bodyid)                                                                       \
  X(mjModel, geom_size, double*, geom_size)                                                                        \
  X(mjModel, site_bodyid, int*, site_bodyid)                                                                       \
  X(mjModel, eq_type, int*, eq_type)                                                                               \
  X(mjModel, eq_obj1id, int*, eq_obj1id)                                                                           \
  X(mjModel, eq_obj2id, int*, eq_obj2id)                                                                           \
  X(mjModel, eq_objtype, int*, eq_objtype)                                                                         \
  X(mjModel, eq_active0, _Bool*, eq_active0)                                                                       \
  X(mjModel, eq_data, double*, eq_data)                                                                            \
  X(mjModel, tendon_adr, int*, tendon_adr)                                                                         \
  X(mjModel, tendon_num, int*, tendon_num)                                                                         \
  X(mjModel, tendon_length0, double*, tendon_length0)                                                              \
  X(mjModel, wrap_type, int*, wrap_type)                                                                           \
  X(mjModel, wrap_objid, int*, wrap_objid)                                                                         \
  X(mjModel, wrap_prm, double*, wrap_prm)                                                                          \
  X(mjModel, M_rownnz, int*, M_rownnz)                                                                             \
  X(mjModel, M_rowadr, int*, M_rowadr)                                                                             \
  X(mjModel, M_colind, int*, M_colind)                                                                             \
  X(mjData, solver_niter, int[20], solver_niter)                                                                   \
  X(mjData, ne, int, ne)                                                                                           \
  X(mjData, nefc, int, nefc)                                                                                       \
  X(mjData, nJ, int, nJ)                                                                                           \
  X(mjData, nisland, int, nisland)                                                                                 \
  X(mjData, time, double, time)                                                                                    \
  X(mjData, energy, double[2], energy)                                                                             \
  X(mjData, qpos, double*, qpos)                                                                                   \
  X(mjData, qvel, double*, qvel)                                                                                   \
  X(mjData, act, double*, act)                                                                                     \
  X(mjData, ctrl, double*, ctrl)                                                                                   \
  X(mjData, eq_active, _Bool*, eq_active)                                                                          \
  X(mjData, qacc, double*, qacc)                                                                                   \
  X(mjData, geom_xpos, double*, geom_xpos)                                                                         \
  X(mjData, geom_xmat, double*, geom_xmat)                                                                         \
  X(mjData, site_xpos, double*, site_xpos)                                                                         \
  X(mjData, subtree_com, double*, subtree_com)                                                                     \
  X(mjData, ten_wrapadr, int*, ten_wrapadr)                                                                        \
  X(mjData, ten_wrapnum, int*, ten_wrapnum)                                                                        \
  X(mjData, ten_length, double*, ten_length)                                                                       \
  X(mjData, wrap_obj, int*, wrap_obj)                                                                              \
  X(mjData, wrap_xpos, double*, wrap_xpos)                                                                         \
  X(mjData, M, double*, M)                                                                                         \
  X(mjData, qLD, double*, qLD)                                                                                     \
  X(mjData, qLDiagInv, double*, qLDiagInv)                                                                         \
  X(mjData, ten_velocity, double*, ten_velocity)                                                                   \
  X(mjData, cvel, double*, cvel)                                                                                   \
  X(mjData, cdof_dot, double*, cdof_dot)                                                                           \
  X(mjData, qfrc_smooth, double*, qfrc_smooth)                                                                     \
  X(mjData, qacc_smooth, double*, qacc_smooth)                                                                     \
  X(mjData, qfrc_constraint, double*, qfrc_constraint)                                                             \
  X(mjData, contact, mjContact*, contact)                                                                          \
  X(mjData, efc_type, int*, efc_type)                                                                              \
  X(mjData, efc_id, int*, efc_id)                                                                                  \
  X(mjData, efc_J_rownnz, int*, efc_J_rownnz)                                                                      \
  X(mjData, efc_J_rowadr, int*, efc_J_rowadr)                                                                      \
  X(mjData, efc_J_colind, int*, efc_J_colind)                                                                      \
  X(mjData, efc_J, double*, efc_J)                                                                                 \
  X(mjData, efc_pos, double*, efc_pos)                                                                             \
  X(mjData, efc_frictionloss, double*, efc_frictionloss)                                                           \
  X(mjData, efc_KBIP, double*, efc_KBIP)                                                                           \
  X(mjData, efc_D, double*, efc_D)                                                                                 \
  X(mjData, efc_R, double*, efc_R)                                                                                 \
  X(mjData, efc_vel, double*, efc_vel)                                                                             \
  X(mjData, efc_aref, double*, efc_aref)                                                                           \
  X(mjData, efc_force, double*, efc_force)                                                                         \
  X(mjContact, friction, double[5], contact_friction)                                                              \
  X(mjContact, mu, double, contact_mu)                                                                             \
  X(mjContact, dim, int, contact_dim)

#endif  // OARLOCK_FIELDS_H_
