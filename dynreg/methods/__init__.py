"""The methods that adapt a simulator to a robot, behind one interface; see `methods.calibrator`."""
