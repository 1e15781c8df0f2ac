"""The appliance: the recorder that runs unattended at home, without a screen."""
