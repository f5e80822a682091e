"""Why do the loops of a model come apart, and by how much less in a file that is mended?

Run: python examples/check_a_model.py MODEL.xml FIXED.xml
"""

import sys

import oarlock

model, fixed = sys.argv[1:]
checked = oarlock.check(model)
print(checked.answer)
for finding in checked.verdict:
    print(f"  {finding.severity:7} {finding.code:3} {finding.line}")

made = checked.fix(fixed)
print(f"\n{fixed}: " + ("holds what is wanted" if made.reached else made.reason))
print(oarlock.check(fixed, budget=0).answer)
