#!/bin/bash
# make_initramfs.sh TREE OUT: from an unpacked Debian kernel package, OUT/vmlinuz and
# OUT/initramfs, which holds busybox, the modules for the host's files, for CAN and for slow queues, and
# qemu_init.sh.
set -eu
tree=$(realpath "$1")
mkdir -p "$2/initramfs.d"
out=$(realpath "$2")
stage=$out/initramfs.d
vm_dir=$(cd "$(dirname "$0")" && pwd)
PATH=$PATH:/usr/sbin:/sbin

cp "$tree"/boot/vmlinuz-* "$out/vmlinuz"
version=$(basename "$tree"/lib/modules/*)
depmod -b "$tree" "$version"
mkdir -p "$stage"/{bin,modules,proc,sys,dev,run}
cp /bin/busybox "$stage/bin/"
ln -s busybox "$stage/bin/sh"
cp "$vm_dir/qemu_init.sh" "$stage/init"

# Each with what it depends on, in the order of loading: 00-name.ko, 01-name.ko, ...
number=0
for module in virtio_pci 9pnet_virtio 9p overlay can-raw vcan sch_tbf; do
    modprobe -d "$tree" -S "$version" --show-depends "$module" | while read -r kind file _; do
        [ "$kind" = insmod ] && echo "$file"
    done
done | awk '!seen[$0]++' | while read -r file; do
    cp "$file" "$stage/modules/$(printf %02d $number)-$(basename "$file")"
    number=$((number + 1))
done

(cd "$stage" && find . | cpio --quiet -o -H newc | gzip -9) >"$out/initramfs.new"
rm -r "$stage"
mv "$out/initramfs.new" "$out/initramfs"
