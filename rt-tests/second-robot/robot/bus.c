/* CAN frames in datagrams, one each: a map in MessagePack with python-can's keys. */
#include "robot.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>

#define GROUP "239.74.163.2"
static const int PORT[BUSES] = {43120, 43121};
static int sockets[BUSES];

static void need(int condition, const char *what) {
    if (condition) return;
    perror(what);
    exit(1);
}

void bus_open(void) {
    for (int b = 0; b < BUSES; b++) {
        int s = sockets[b] = socket(AF_INET, SOCK_DGRAM | SOCK_NONBLOCK, 0), one = 1;
        need(s >= 0, "socket");
        int size = 1 << 20;
        need(!setsockopt(s, SOL_SOCKET, SO_REUSEADDR, &one, sizeof one), "SO_REUSEADDR");
        need(!setsockopt(s, SOL_SOCKET, SO_REUSEPORT, &one, sizeof one), "SO_REUSEPORT");
        need(!setsockopt(s, SOL_SOCKET, SO_TIMESTAMPNS, &one, sizeof one), "SO_TIMESTAMPNS");
        setsockopt(s, SOL_SOCKET, SO_RCVBUF, &size, sizeof size);
        unsigned char hops = 0;
        need(!setsockopt(s, IPPROTO_IP, IP_MULTICAST_TTL, &hops, sizeof hops), "IP_MULTICAST_TTL");
        struct sockaddr_in a = {.sin_family = AF_INET, .sin_port = htons(PORT[b])};
        inet_pton(AF_INET, GROUP, &a.sin_addr);
        need(!bind(s, (struct sockaddr *)&a, sizeof a), "bind");
        struct ip_mreq m = {.imr_multiaddr = a.sin_addr, .imr_interface.s_addr = htonl(INADDR_ANY)};
        need(!setsockopt(s, IPPROTO_IP, IP_ADD_MEMBERSHIP, &m, sizeof m), "IP_ADD_MEMBERSHIP");
    }
}

int bus_socket(int bus) { return sockets[bus]; }

static uint8_t *key(uint8_t *p, const char *name) {
    size_t n = strlen(name);
    *p = 0xa0 | n;
    memcpy(p + 1, name, n);
    return p + 1 + n;
}

static uint8_t *flag(uint8_t *p, const char *name, int value) {
    p = key(p, name);
    *p = value ? 0xc3 : 0xc2;
    return p + 1;
}

void bus_send(int bus, int id, const uint8_t *data, int length) {
    uint8_t datagram[400], *p = datagram;
    *p++ = 0x8b; /* a map of eleven */
    p = key(p, "timestamp");
    *p++ = 0xcb;
    memset(p, 0, 8);
    p = key(p + 8, "arbitration_id");
    *p++ = 0xcd;
    *p++ = id >> 8;
    *p++ = id & 0xff;
    p = flag(p, "is_extended_id", 0);
    p = flag(p, "is_remote_frame", 0);
    p = flag(p, "is_error_frame", 0);
    p = key(p, "channel");
    *p++ = 0xc0;
    p = key(p, "dlc");
    *p++ = length;
    p = key(p, "data");
    *p++ = 0xc4;
    *p++ = length;
    memcpy(p, data, length);
    p = flag(p + length, "is_fd", length > 8);
    p = flag(p, "bitrate_switch", 0);
    p = flag(p, "error_state_indicator", 0);
    struct sockaddr_in a = {.sin_family = AF_INET, .sin_port = htons(PORT[bus])};
    inet_pton(AF_INET, GROUP, &a.sin_addr);
    sendto(sockets[bus], datagram, p - datagram, 0, (struct sockaddr *)&a, sizeof a);
}

/* A cursor over a datagram; `bad` once something is not understood or ends too early. */
struct cursor { const uint8_t *at, *end; int bad; };

static unsigned long number(struct cursor *c, int bytes) {
    if (c->end - c->at < bytes) { c->bad = 1; return 0; }
    unsigned long v = 0;
    while (bytes--) v = v << 8 | *c->at++;
    return v;
}

/* One value: whole number, true, or bytes; strings, floats and nil are passed over. */
static unsigned long value(struct cursor *c, const uint8_t **bytes, int *length) {
    unsigned long tag = number(c, 1), n;
    if (tag < 0x80) return tag;
    if (tag >= 0xa0 && tag < 0xc0) { n = tag & 31; }
    else switch (tag) {
        case 0xc0: case 0xc2: return 0;
        case 0xc3: return 1;
        case 0xc4: case 0xd9: n = number(c, 1); break;
        case 0xcc: return number(c, 1);
        case 0xcd: return number(c, 2);
        case 0xce: return number(c, 4);
        case 0xcf: case 0xcb: return number(c, 8);
        default: c->bad = 1; return 0;
    }
    if (c->bad || (unsigned long)(c->end - c->at) < n) { c->bad = 1; return 0; }
    *bytes = c->at;
    *length = n;
    c->at += n;
    return 0;
}

int bus_parse(const uint8_t *datagram, int length, const uint8_t **data, int *data_length) {
    struct cursor c = {datagram, datagram + length, 0};
    unsigned long tag = number(&c, 1);
    if ((tag & 0xf0) != 0x80) return -1;
    int id = -1, remote = 0;
    *data_length = 0;
    for (int n = tag & 15; n > 0 && !c.bad; n--) {
        const uint8_t *name = 0, *bytes = 0;
        int name_length = 0, bytes_length = 0;
        value(&c, &name, &name_length);
        unsigned long v = value(&c, &bytes, &bytes_length);
        if (!name) return -1;
        if (name_length == 14 && !memcmp(name, "arbitration_id", 14)) id = v;
        if (name_length == 15 && !memcmp(name, "is_remote_frame", 15)) remote = v;
        if (name_length == 4 && !memcmp(name, "data", 4) && bytes) { *data = bytes; *data_length = bytes_length; }
    }
    return c.bad || remote ? -1 : id;
}
