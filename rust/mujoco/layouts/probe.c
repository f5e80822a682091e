// Prints the layout of the MuJoCo whose headers it is compiled against, as a row of table.h.
//
// What the shim takes for granted in every version is asserted: where one asserts otherwise, it does not compile.
#include <assert.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include <mujoco/mujoco.h>

#include "fields.h"
#include "functions.h"

#define SAME(expression, ...) __builtin_types_compatible_p(__typeof__(expression), __VA_ARGS__)

#define FIELD(whole, field, type, name) static_assert(SAME(((whole*)0)->field, type), #whole "." #field);
OARLOCK_FIELDS(FIELD)
#undef FIELD

#define FUNCTION(name, result, parameters) static_assert(SAME(name, result parameters), #name);
OARLOCK_FUNCTIONS(FUNCTION)
#undef FUNCTION

#define ENUM(name, number) static_assert(name == (number), #name);
OARLOCK_ENUMS(ENUM)
#undef ENUM

static_assert(SAME(mjcb_control, oarlock_generic) && SAME(mjcb_time, oarlock_clock), "hooks");
static_assert(SAME(((mjLogMessage*)0)->subject, char[sizeof(((oarlock_log*)0)->subject)]), "mjLogMessage.subject");
static_assert(SAME(((mjLogMessage*)0)->level, int) && offsetof(mjLogMessage, level) == offsetof(oarlock_log, level) &&
                  offsetof(mjLogMessage, subject) == offsetof(oarlock_log, subject) && mjLOG_ERROR == OARLOCK_ERROR,
              "mjLogMessage");
static_assert(SAME(mjtNum, double) && sizeof(mjtBool) == 1, "mjtype.h");

int main(void) {
  printf("%d,%d,%zu", mjVERSION_HEADER, mjNEQDATA, sizeof(mjContact));
#define FIELD(whole, field, type, name) printf(",%zu", offsetof(whole, field));
  OARLOCK_FIELDS(FIELD)
#undef FIELD
  return 0;
}
