"""How much model a person needs: a ladder of sizes, and each part of the method left out alone."""
