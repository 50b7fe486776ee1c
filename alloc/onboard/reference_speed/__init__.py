"""The speed that slip is measured from: one estimate for traction, brakes, slide protection and controllers."""
