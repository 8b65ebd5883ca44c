/* VRPN beside `dev.py bench peers`: what its library takes for the same datagrams, without session, physics, encryption or recording.

   A connection of VRPN has one port, and sends each message to everyone on it. So a room is a connection, and 128 times a second each
   receives what has come, adds up the waves, and sends one message as long as the last that came. `vrpn PEOPLE PER_ROOM [PROCESSOR]`. */

#include "bare_server.h"
#include "vrpn_Connection.h"
#include <arpa/inet.h>
#include <string>
#include <sys/socket.h>
#include <vector>

static const int TRIES = 100;
static double sum; // of all waves, so that no compiler leaves them out

struct Room {
    vrpn_Connection *connection;
    int port, sender, type;
    std::vector<char> answer;
};

static int VRPN_CALLBACK receive(void *data, vrpn_HANDLERPARAM message) {
    Room *room = static_cast<Room *>(data);
    sum += values_in(reinterpret_cast<const unsigned char *>(message.buffer), message.payload_len);
    room->answer.assign(message.buffer, message.buffer + message.payload_len);
    return 0;
}

// A port that both TCP and UDP have free: VRPN wants the same of each, and does not say which it got.
static int free_port() {
    for (int each = 0; each < TRIES; each++) {
        int stream = socket(AF_INET, SOCK_STREAM, 0), datagrams = socket(AF_INET, SOCK_DGRAM, 0);
        sockaddr_in here = {};
        here.sin_family = AF_INET;
        here.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
        socklen_t length = sizeof here;
        sockaddr *address = reinterpret_cast<sockaddr *>(&here);
        bool found = !bind(stream, address, sizeof here) && !getsockname(stream, address, &length) &&
                     !bind(datagrams, address, sizeof here);
        close(stream);
        close(datagrams);
        if (found)
            return ntohs(here.sin_port);
    }
    return 0;
}

static bool open_room(Room &room) {
    for (int each = 0; each < TRIES; each++) {
        room.port = free_port();
        room.connection = vrpn_create_server_connection(room.port, NULL, NULL, "127.0.0.1");
        if (room.connection && room.connection->doing_okay()) {
            room.sender = room.connection->register_sender("object");
            room.type = room.connection->register_message_type("waves");
            room.connection->register_handler(room.type, receive, &room);
            return true;
        }
    }
    return false;
}

int main(int count, char **arguments) {
    if (count < 3) {
        fputs("vrpn: PEOPLE PER_ROOM [PROCESSOR]\n", stderr);
        return 2;
    }
    int per_room = atoi(arguments[2]);
    std::vector<Room> rooms((atoi(arguments[1]) + per_room - 1) / per_room);
    FILE *out = fdopen(dup(STDOUT_FILENO), "w"); // VRPN itself prints who comes, and who goes as an error
    if (!out || !freopen("/dev/null", "w", stdout)) {
        perror("vrpn: standard output");
        return 1;
    }
    std::string ports;
    for (Room &room : rooms) {
        if (!open_room(room)) {
            fputs("vrpn: no connection can be opened\n", stderr);
            return 1;
        }
        ports += (ports.empty() ? "" : ",") + std::to_string(room.port);
    }
    fprintf(out, "{\"port\":%d,\"ports\":[%s]}\n", rooms[0].port, ports.c_str());
    fflush(out);
    if (engage(count > 3 ? arguments[3] : NULL))
        return 1;
    if (!freopen("/dev/null", "w", stderr))
        return 1;
    do {
        wait_for_frame();
        timeval time;
        for (Room &room : rooms) {
            room.connection->mainloop();
            if (room.answer.empty())
                continue;
            vrpn_gettimeofday(&time, NULL);
            room.connection->pack_message(room.answer.size(), time, room.type, room.sender, room.answer.data(),
                                          vrpn_CONNECTION_LOW_LATENCY);
            room.connection->send_pending_reports();
            room.answer.clear();
        }
    } while (!end_frame(out));
    _exit(sum == 0.0); // nobody has sent a wave
}
