/* Ticks with a contact, one line each. cc -o contacts contacts.c; ./contacts VIEW_SOCKET
 * One packet is one message of JSON; a real program reads it with a library for that. */
#include <err.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/un.h>
#include <unistd.h>

#define LARGEST (2 << 20) /* bytes of one message */

static int dial(const char *path)
{
    struct sockaddr_un where = {.sun_family = AF_UNIX};
    struct timeval patience = {.tv_sec = 2}; /* it speaks every tick */
    int door = socket(AF_UNIX, SOCK_SEQPACKET, 0);

    if (strlen(path) >= sizeof where.sun_path)
        errx(1, "%s: too long for a socket", path);
    strcpy(where.sun_path, path);
    if (door < 0 || connect(door, (struct sockaddr *)&where, sizeof where))
        err(1, "%s", path);
    setsockopt(door, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    return door;
}

int main(int argc, char **argv)
{
    static const char subscribe[] = "{\"command\":\"subscribe\"}";
    static char packet[LARGEST + 1];
    ssize_t size;
    int door;

    if (argc != 2)
        errx(2, "usage: contacts VIEW_SOCKET");
    door = dial(argv[1]);
    if (send(door, subscribe, sizeof subscribe - 1, 0) < 0)
        err(1, "send");
    while ((size = recv(door, packet, LARGEST, 0)) > 0) {
        packet[size] = 0;
        if (!strncmp(packet, "{\"ok\":false", 11))
            errx(1, "%s", packet);
        if (strstr(packet, "\"kind\":\"contact\"") && !strncmp(packet, "{\"tick\":", 8)) {
            printf("tick %ld\n", atol(packet + 8));
            fflush(stdout);
        }
    }
    if (size < 0)
        err(1, "the daemon fell silent");
    errx(1, "the daemon ended");
}
