#!/bin/bash
# The first process in User-Mode Linux. RESULTS comes from the kernel's command line.
set -eu
export PATH=/usr/sbin:/usr/bin:/sbin:/bin
# Whatever happens, power off: pid 1 must not end.
trap 'echo o >/proc/sysrq-trigger; sleep infinity' EXIT

mount -t proc proc /proc
mount -t sysfs sys /sys
mount -t tmpfs tmpfs /run

modules=/usr/lib/uml/modules/$(uname -r)/kernel
for module in fs/overlayfs/overlay net/can/can net/can/can-raw net/can/can-bcm net/can/can-gw \
    drivers/net/can/dev/can-dev drivers/net/can/vcan drivers/net/can/vxcan net/sched/sch_tbf; do
    insmod "$modules/$module.ko"
done

# The host's files, with a tmpfs over them for what is written.
mkdir /run/upper /run/work /run/root
mount -t overlay overlay -o lowerdir=/,upperdir=/run/upper,workdir=/run/work /run/root
cd /run/root
mount -t proc proc proc
mount -t sysfs sys sys
mount -t devtmpfs dev dev
mkdir -p dev/shm dev/pts
ln -s /proc/self/fd dev/fd
mount -t tmpfs -o mode=1777 tmpfs dev/shm
mount -t devpts devpts dev/pts
mount -t tmpfs tmpfs run
mkdir -p ".$RESULTS"
mount -t hostfs -o "$RESULTS" none ".$RESULTS"

stty -F /dev/tty1 -opost # passes the command's output on as it is
chroot . /bin/bash "$RESULTS/.vm/guest.sh" "$RESULTS" >/dev/tty1 2>&1
