// What tests ask of the package for .NET from within: compiled together with it, so that it sees what is internal.
using System;
using System.Globalization;
using System.Reflection;
using System.Runtime.InteropServices;
using Cogrip;

internal static class Probe
{
    private static readonly SeatOptions Options = new SeatOptions { Axes = 3, PeakForceN = 8.0, SpeedMps = 2.0 };

    private static int Main(string[] arguments)
    {
        switch (arguments[0])
        {
            case "layout": return Layout();
            case "names": return Names();
            case "garbage": return Garbage(int.Parse(arguments[1]));
            case "fails": return Fails(arguments[1]);
            default: return 2;
        }
    }

    private static int Layout()
    {
        foreach (var field in typeof(Native.Config).GetFields(BindingFlags.Instance | BindingFlags.NonPublic))
            Console.WriteLine($"cogrip_config {Marshal.OffsetOf(typeof(Native.Config), field.Name)}");
        Console.WriteLine($"cogrip_config {Marshal.SizeOf(typeof(Native.Config))}");
        foreach (var at in new[] { SeatStatus.StateAt, SeatStatus.SafetyAt, SeatStatus.AxesAt, SeatStatus.DeviceHzAt,
            SeatStatus.NetworkHzAt, SeatStatus.SeatAt, SeatStatus.TickAt, SeatStatus.NumbersAt, SeatStatus.DownAt,
            SeatStatus.RoomAt, SeatStatus.UserAt, SeatStatus.Bytes })
            Console.WriteLine($"cogrip_status {at}");
        return 0;
    }

    /// <summary>Each number of a status by its name, where number k of the struct is k.</summary>
    private static int Names()
    {
        var memory = new Memory(SeatStatus.Bytes);
        var status = new SeatStatus();
        for (var at = 0; at < SeatStatus.NumbersAt; at += 4) Marshal.WriteInt32(memory.At, at, at);
        for (var at = SeatStatus.NumbersAt; at < SeatStatus.DownAt; at += 8)
            Marshal.WriteInt64(memory.At, at, BitConverter.DoubleToInt64Bits(at));
        for (var at = SeatStatus.DownAt; at < SeatStatus.RoomAt; at += 8) Marshal.WriteInt64(memory.At, at, at);
        Marshal.WriteInt64(memory.At, SeatStatus.TickAt, SeatStatus.TickAt);
        status.Fill(memory.At);
        var copy = new SeatStatus();
        copy.CopyFrom(status);
        foreach (var property in typeof(SeatStatus).GetProperties(BindingFlags.Instance | BindingFlags.Public))
        {
            var value = property.GetValue(copy);
            if (value is Vector vector) Console.WriteLine($"{property.Name} {vector.X} {vector.Y} {vector.Z}");
            else Console.WriteLine($"{property.Name} {Convert.ToInt64(value)}");
        }
        return 0;
    }

    /// <summary>Ticks of a seat that no server gives: how often was memory collected?</summary>
    private static int Garbage(int ticks)
    {
        var seat = new Seat("127.0.0.1:9", Options);
        var status = new SeatStatus();
        double[] position = new double[3], force = new double[3];
        for (var tick = 0; tick < 100; tick++)
        {
            seat.Tick(tick, position, force);
            seat.Read(status);
        }
        GC.Collect();
        var before = GC.CollectionCount(0);
        for (var tick = 0; tick < ticks; tick++)
        {
            seat.Tick(tick, position, force);
            seat.TickWithoutSample(tick, force);
            seat.Read(status);
        }
        var during = GC.CollectionCount(0) - before;
        for (var each = 0; each < ticks; each++) position = new double[3]; // what it counts at all
        Console.WriteLine($"{during} {GC.CollectionCount(0) - before - during}");
        seat.Dispose();
        return 0;
    }

    /// <summary>A device that works for half a second, then throws.</summary>
    private static int Fails(string target)
    {
        var device = new Failing();
        using (var loop = new SeatLoop(target, Options, device))
        {
            loop.Start();
            while (!loop.Ended) System.Threading.Thread.Sleep(5);
            Console.WriteLine(
                string.Format(CultureInfo.InvariantCulture, "{0} {1} {2}", device.PeakN, device.StepN, device.LastN));
            Console.WriteLine(loop.Reason);
        }
        return 0;
    }

    private sealed class Failing : IHapticDevice
    {
        private const int GoodTicks = 512, AllTicks = 1024;
        private readonly GuidedHand _hand = new GuidedHand();
        internal double PeakN, StepN, LastN;

        public void Begin(int hz) => _hand.Begin(hz);

        public bool Read(long tick, out Vector positionM)
        {
            _hand.Guide(new Vector(0.05, 0.0, 0.0));
            if (tick >= GoodTicks) throw new InvalidOperationException("its cable is out");
            return _hand.Read(tick, out positionM);
        }

        public void Push(Vector onHandN)
        {
            _hand.Push(onHandN);
            PeakN = Math.Max(PeakN, onHandN.Length);
            StepN = Math.Max(StepN, Math.Abs(onHandN.Length - LastN));
            LastN = onHandN.Length;
            if (++_pushed == AllTicks) throw new InvalidOperationException("its motors are off");
        }

        private int _pushed;
    }
}
