"""User constraints and user costs: functions of symbolic quantities of the arm, compiled and checked."""
