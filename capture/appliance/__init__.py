"""The appliance: what runs by itself at home, without a screen or anybody who looks after it."""
