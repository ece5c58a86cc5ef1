#!/bin/sh
# The first process in QEMU, run by busybox in the initramfs. RESULTS is on the kernel's
# command line.
export PATH=/bin:/usr/sbin:/usr/bin:/sbin
busybox mount -t proc proc /proc
busybox mount -t sysfs sys /sys
busybox mount -t devtmpfs dev /dev
for module in /modules/*; do busybox insmod "$module"; done

host() { # TAG FOLDER OPTIONS: a folder of the host's over 9p
    busybox mount -t 9p -o "trans=virtio,version=9p2000.L,msize=262144,$3" "$1" "$2"
}
busybox mount -t tmpfs tmpfs /run
busybox mkdir -p /run/host /run/over/upper /run/over/work /root
host host /run/host ro,cache=loose
busybox mount -t overlay overlay -o lowerdir=/run/host,upperdir=/run/over/upper,workdir=/run/over/work /root
busybox mount -t proc proc /root/proc
busybox mount -t sysfs sys /root/sys
busybox mount -t devtmpfs dev /root/dev
busybox mkdir -p /root/dev/shm /root/dev/pts "/root$RESULTS"
busybox ln -s /proc/self/fd /root/dev/fd
busybox mount -t tmpfs -o mode=1777 tmpfs /root/dev/shm
busybox mount -t devpts devpts /root/dev/pts
busybox mount -t tmpfs tmpfs /root/run
host results "/root$RESULTS" cache=none

busybox stty -F /dev/ttyS1 -opost
# The one CPU may be loaded fully by real-time threads: no throttling.
echo -1 >/proc/sys/kernel/sched_rt_runtime_us
busybox chroot /root /bin/bash "$RESULTS/.vm/guest.sh" "$RESULTS" >/dev/ttyS1 2>&1 </dev/null
echo o >/proc/sysrq-trigger
busybox sleep 1000
