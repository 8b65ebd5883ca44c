// One simulated hand holds the object of a running server, as example.c, with the thread of the package.
//
//     mono Example.exe TARGET [SECONDS [NAME]]        TARGET: a join link, HOST:PORT, or - to read it from standard input
using System;
using System.Globalization;
using System.Threading;
using Cogrip;

internal static class Example
{
    private const int FrameMs = 16; // of a screen: what says where the hand is to be

    private static int Main(string[] arguments)
    {
        if (arguments.Length < 1 || arguments.Length > 3)
        {
            Console.Error.WriteLine(
                "usage: Example TARGET [SECONDS [NAME]]   TARGET: a join link, HOST:PORT, or - for standard input");
            return 2;
        }
        var target = arguments[0] == "-" ? Console.In.ReadLine() ?? "" : arguments[0];
        var seconds = arguments.Length > 1 ? double.Parse(arguments[1], CultureInfo.InvariantCulture) : 10.0;
        var options = new SeatOptions
        {
            Name = arguments.Length > 2 ? arguments[2] : "", Device = "csharp:spring", RateHz = 4096.0, PeakForceN = 8.0,
            SpeedMps = 2.0, ApparentMassKg = GuidedHand.MassKg,
        };
        var hand = new GuidedHand();
        var status = new SeatStatus();
        using (var loop = new SeatLoop(target, options, hand))
        {
            loop.Start();
            var heard = false;
            while (!loop.Ended)
            {
                Thread.Sleep(FrameMs);
                loop.Read(status);
                if (status.DeviceHz == 0) continue;
                if (!heard) Console.Error.WriteLine($"example: {loop.User} holds the object at {status.DeviceHz} Hz");
                heard = true;
                var time = (double)status.Tick / status.DeviceHz;
                hand.Guide(new Vector(0.03 * (1.0 - Math.Cos(Math.PI * time)), 0.0, 0.0));
                if (time >= seconds) loop.Stop();
            }
            loop.Read(status);
            if (heard)
                Console.WriteLine(string.Format(CultureInfo.InvariantCulture,
                    "{{\"library\": \"{0}\", \"ticks\": {1}, \"frames\": {2}, \"rtt_ms\": {3:F3}, \"peak_force_n\": {4:F3}, "
                    + "\"object_m\": {5:F6}, \"device_margin_j\": {6:0.000e+0}}}",
                    Seat.LibraryVersion, status.Tick, status.FramesApplied, status.RttMs, status.PeakForceN, status.ObjectM.X,
                    status.DeviceMarginJ));
            if (loop.Reason.Length == 0) return 0;
            Console.Error.WriteLine("example: " + loop.Reason);
            return 1;
        }
    }
}
