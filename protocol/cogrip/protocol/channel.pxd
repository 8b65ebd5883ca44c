# compiled as it is: an unencrypted end calls it for every datagram
