"""Run a program on a machine with simulated sensors.

    umockdev-wrapper /usr/bin/python3 mocked_bus.py MODEL[:FAULT]... -- PROGRAM [ARGUMENTS]

The distribution's Python runs this, because only that one has the bindings of umockdev. The program is started below it
and sees the devices through ordinary libusb: sysfs and /dev/bus/usb are mocked, and the calls that libusb makes on a
device node are answered here from a model. Structures: Linux's `include/uapi/linux/usbdevice_fs.h`.

Prints the models' received requests to standard error when the program ends, and exits with its code.
"""

import os
import struct
import subprocess
import sys
import threading

import gi

gi.require_version("UMockdev", "1.0")
from gi.repository import GLib, UMockdev  # noqa: E402

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import models  # noqa: E402
import streams  # noqa: E402

MODELS = {
    "ps1080": models.Ps1080Model, "streaming": streams.StreamingPs1080Model,
    "motor": models.KinectMotorModel, "camera": models.KinectCameraModel,
}  # fmt: skip

URB = struct.Struct("@BBiIPiiiiiIP")  # struct usbdevfs_urb up to its user context, 64 bit
URB_TYPE, URB_ENDPOINT, URB_STATUS, URB_LENGTH, URB_ACTUAL = 0, 1, 2, 5, 6
URB_BUFFER_AT = 16  # offset of the pointer to the buffer
BULK = 3  # USBDEVFS_URB_TYPE_BULK
SETUP = struct.Struct("<BBHHH")
SUBMIT, REAP, REAP_NOW, DISCARD = 0x8038550A, 0x4008550C, 0x4008550D, 0x0000550B
CAPABILITIES, CLAIM, RELEASE, CONFIGURE, GET_DRIVER = 0x8004551A, 0x8004550F, 0x80045510, 0x80045505, 0x41045508
SET_INTERFACE = 0x80085504
PIPE, NO_DEVICE, NO_ENTRY, AGAIN, NO_DATA, NOT_A_TERMINAL = 32, 19, 2, 11, 61, 25


def descriptors(model):
    """Device and configuration descriptor: one vendor interface, 500 mA; a sensor that streams has three endpoints."""
    ends = (0x81, 0x82, 0x83) if isinstance(model, streams.StreamingPs1080Model) else ()
    device = struct.pack(
        "<BBHBBBBHHHBBBB", 18, 1, 0x0200, 0, 0, 0, 64, model.vendor, model.product, 1, 0, 0, 3 if model.serial else 0, 1
    )
    interface = struct.pack("<BBBBBBBBB", 9, 4, 0, 0, len(ends), 0xFF, 0, 0, 0)
    interface += b"".join(struct.pack("<BBBBHB", 7, 5, end, 2, 512, 0) for end in ends)
    return device + struct.pack("<BBHBBBBB", 9, 2, 9 + len(interface), 1, 1, 0, 0x80, 250) + interface


def place(address, model):
    """The entry of the device in the mocked sysfs."""
    return f"""P: /devices/pci0000:00/0000:00:14.0/usb1/1-{address}
N: bus/usb/001/{address:03}
E: DEVNAME=/dev/bus/usb/001/{address:03}
E: DEVTYPE=usb_device
E: SUBSYSTEM=usb
E: BUSNUM=001
E: DEVNUM={address:03}
E: MAJOR=189
E: MINOR={address - 1}
E: PRODUCT={model.vendor:x}/{model.product:x}/1
A: busnum=1\\n
A: devnum={address}\\n
A: speed=480\\n
A: bConfigurationValue=1\\n
A: idVendor={model.vendor:04x}\\n
A: idProduct={model.product:04x}\\n
H: descriptors={descriptors(model).hex().upper()}
"""


class Gate:
    """The device node that libusb polls, writable only while a finished transfer is waiting.

    umockdev's nodes are always writable, so libusb would poll without a pause and starve its other threads. A pipe in
    place of the node is writable unless it is full.
    """

    def __init__(self, path):
        os.remove(path)
        os.mkfifo(path)
        self.end = os.open(path, os.O_RDWR | os.O_NONBLOCK)

    def open(self):
        """Let the waiting threads through."""
        try:
            while os.read(self.end, 1 << 16):
                pass
        except BlockingIOError:
            pass

    def close(self):
        """Make them wait."""
        try:
            while os.write(self.end, bytes(1 << 12)):
                pass
        except BlockingIOError:
            pass


class Node(UMockdev.IoctlBase):
    """Answers for one device node."""

    def __init__(self, model, path):
        super().__init__()
        self.gate = Gate(path)
        self.model, self.finished, self.silent, self.is_gone = model, [], [], False
        self.reading = []

    def do_handle_ioctl(self, client):
        """Answer one call; an error here must not stop the main loop."""
        try:
            self.answer(client, client.get_request() & 0xFFFFFFFF)
        except GLib.Error as error:
            print("mocked bus:", error, file=sys.stderr)
            client.complete(-1, NOT_A_TERMINAL)
        return True

    def answer(self, client, request):
        """Answer one call on the node."""
        if request == SUBMIT and not self.is_gone:
            self.submit(client)
        elif request in (REAP, REAP_NOW):
            if not self.finished:
                self.serve()
            if self.finished:
                client.get_arg().resolve(0, 8).set_ptr(0, self.finished.pop(0))
                client.complete(0, 0)
            elif self.is_gone:
                client.complete(-1, NO_DEVICE)
            else:
                self.gate.close()
                client.complete(-1, AGAIN)
        elif self.is_gone:
            client.complete(-1, NO_DEVICE)
        elif request == DISCARD:
            for urb, fields, *_ in [*self.silent, *self.reading]:
                self.finish(urb, fields, -NO_ENTRY, 0)
            self.silent.clear()
            self.reading.clear()
            client.complete(0, 0)
        elif request == CAPABILITIES:
            client.get_arg().resolve(0, 4).update(0, struct.pack("<I", 0))
            client.complete(0, 0)
        elif request in (CLAIM, RELEASE, CONFIGURE, SET_INTERFACE):
            client.complete(0, 0)
        elif request == GET_DRIVER:
            client.complete(-1, NO_DATA)
        else:
            client.complete(-1, NOT_A_TERMINAL)

    def submit(self, client):
        """Take a control transfer and let the model answer it."""
        urb = client.get_arg().resolve(0, URB.size)
        fields = list(URB.unpack(bytes(urb.retrieve())))
        buffer = urb.resolve(URB_BUFFER_AT, fields[URB_LENGTH])
        if fields[URB_TYPE] == BULK:
            self.reading.append((urb, fields, buffer))
            client.complete(0, 0)
            return
        raw = bytes(buffer.retrieve())
        kind, request, value, _, length = SETUP.unpack_from(raw)
        data = raw[SETUP.size : SETUP.size + length]
        try:
            if kind == 0x80:
                answer = models.string_descriptor(self.model.serial, value)[:length]
            else:
                answer = self.model.control(kind, request, value, data, length)
        except models.StallError:
            self.finish(urb, fields, -PIPE, 0)
        except models.SilenceError:
            self.silent.append((urb, fields))
        except models.GoneError:
            self.is_gone = True
            self.gate.open()
            client.complete(-1, NO_DEVICE)
            return
        else:
            if kind & 0x80 and answer:
                buffer.update(SETUP.size, answer)
            self.finish(urb, fields, 0, len(answer) if kind & 0x80 else length)
        client.complete(0, 0)

    def serve(self):
        """Complete the oldest transfer of each endpoint with the model's data."""
        served = set()
        for waiting in list(self.reading):
            urb, fields, buffer = waiting
            endpoint = fields[URB_ENDPOINT]
            data = None if endpoint in served else self.model.read(endpoint, fields[URB_LENGTH])
            served.add(endpoint)
            if data is not None:
                self.reading.remove(waiting)
                buffer.update(0, data)
                self.finish(urb, fields, 0, len(data))

    def finish(self, urb, fields, status, count):
        """Write the result into the caller's transfer and put it where it is reaped."""
        fields[URB_STATUS], fields[URB_ACTUAL] = status, count
        urb.update(0, URB.pack(*fields))
        self.finished.append(urb)
        self.gate.open()


def main(arguments):
    """Build the bus, run the program, report."""
    split = arguments.index("--")
    made = [MODELS[name](fault) for name, _, fault in (word.partition(":") for word in arguments[:split])]
    bed = UMockdev.Testbed.new()
    for address, model in enumerate(made, 4):
        bed.add_from_string(place(address, model))
    # Kept in a list, since umockdev holds no Python reference.
    nodes = [Node(model, f"{bed.get_root_dir()}/dev/bus/usb/001/{place:03}") for place, model in enumerate(made, 4)]
    for address, node in enumerate(nodes, 4):
        bed.attach_ioctl(f"/dev/bus/usb/001/{address:03}", node)
    loop, codes = GLib.MainLoop(), []

    def run():
        codes.append(subprocess.call(arguments[split + 1 :]))
        GLib.idle_add(loop.quit)

    def tick():
        for node in nodes:
            if isinstance(node.model, streams.StreamingPs1080Model):
                node.model.tick()
                node.is_gone = node.is_gone or node.model.is_pulled
                if node.is_gone or any(node.model.waiting.values()):
                    node.gate.open()
        return True

    GLib.timeout_add(1000 // streams.FPS, tick)
    threading.Thread(target=run, daemon=True).start()
    loop.run()
    for model in made:
        told = {
            name: value
            for name, value in vars(model).items()
            if name in ("led", "mode", "emitter", "tilt", "parameters")
        }
        print(f"{type(model).__name__}: {told}", file=sys.stderr)
    return codes[0]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
