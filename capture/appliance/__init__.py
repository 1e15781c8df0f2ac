"""The appliance: the recorder that runs alone at home, without a screen or anybody who looks after it."""
