/* The far end of `dev.py bench peers`: what a server's datagrams cost in C, without session, physics, encryption or recording.

   128 times a second it takes all datagrams that have come with one recvmmsg, adds up the waves of each, and answers each with one of
   the same size, all with one sendmmsg. `twin [PROCESSOR]`. */

#include "bare_server.h"
#include <arpa/inet.h>
#include <sys/socket.h>

enum { MOST = 1024, BYTES = 2048, BUFFER_BYTES = 8 << 20 };

static unsigned char datagrams[MOST][BYTES];
static struct sockaddr_in addresses[MOST];
static struct iovec parts[MOST];
static struct mmsghdr messages[MOST];
static double sum; /* of all waves, so that no compiler leaves them out */

int main(int count, char **arguments) {
    int end = socket(AF_INET, SOCK_DGRAM | SOCK_NONBLOCK, 0), bytes = BUFFER_BYTES;
    struct sockaddr_in here = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    socklen_t length = sizeof here;
    setsockopt(end, SOL_SOCKET, SO_RCVBUF, &bytes, sizeof bytes);
    setsockopt(end, SOL_SOCKET, SO_RCVBUFFORCE, &bytes, sizeof bytes); /* where it may */
    if (end < 0 || bind(end, (struct sockaddr *)&here, sizeof here) || getsockname(end, (struct sockaddr *)&here, &length)) {
        perror("twin: socket");
        return 1;
    }
    for (int each = 0; each < MOST; each++) {
        parts[each] = (struct iovec){datagrams[each], BYTES};
        messages[each].msg_hdr = (struct msghdr){.msg_name = &addresses[each], .msg_iov = &parts[each], .msg_iovlen = 1};
    }
    printf("{\"port\":%d}\n", ntohs(here.sin_port));
    fflush(stdout);
    if (engage(count > 1 ? arguments[1] : NULL))
        return 1;
    do {
        wait_for_frame();
        for (;;) {
            for (int each = 0; each < MOST; each++) {
                parts[each].iov_len = BYTES;
                messages[each].msg_hdr.msg_namelen = sizeof addresses[each];
            }
            int came = recvmmsg(end, messages, MOST, MSG_DONTWAIT, NULL);
            if (came <= 0)
                break;
            for (int each = 0; each < came; each++) {
                sum += values_in(datagrams[each], messages[each].msg_len);
                parts[each].iov_len = messages[each].msg_len;
            }
            for (int sent = 0, some; sent < came; sent += some)
                if ((some = sendmmsg(end, messages + sent, came - sent, 0)) <= 0)
                    some = 1; /* the first of them cannot be sent */
            if (came < MOST)
                break;
        }
    } while (!end_frame(stdout));
    return sum == 0.0; /* nobody has sent a wave */
}
