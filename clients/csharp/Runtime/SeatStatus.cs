using System;
using System.Runtime.InteropServices;

namespace Cogrip
{
    /// <summary>Where a seat session stands.</summary>
    public enum SeatState
    {
        /// <summary>Nothing was asked for.</summary>
        Idle,
        /// <summary>A seat is asked for.</summary>
        Connecting,
        /// <summary>The seat is held.</summary>
        Seated,
        /// <summary>The server fell silent: the seat is asked for again.</summary>
        Resuming,
        /// <summary>Hand and object are being released.</summary>
        Leaving,
        /// <summary>The session is over.</summary>
        Closed,
    }

    /// <summary>What lets the force through: <see cref="Live"/> alone does. Every change between these ramps it.</summary>
    public enum Safety
    {
        /// <summary>There is no seat.</summary>
        Released,
        /// <summary>The force is let through.</summary>
        Live,
        /// <summary>Nothing new comes from the server.</summary>
        Stale,
        /// <summary>The device or the loop failed; until <see cref="Seat.Rearm"/>.</summary>
        Fault,
    }

    /// <summary>All that one may want to show of a seat. Filled anew without taking memory; margins are NaN where nothing is
    /// known.</summary>
    public sealed class SeatStatus
    {
        /// <summary>Places in cogrip_status [bytes]; the test of this package compares them with cogrip.h.</summary>
        internal const int
            StateAt = 0, SafetyAt = 4, AxesAt = 8, DeviceHzAt = 12, NetworkHzAt = 16, SeatAt = 20, TickAt = 24, NumbersAt = 32,
            DownAt = 240, RoomAt = 296, UserAt = 457, Bytes = 624;

        private const int Numbers = (DownAt - NumbersAt) / 8;
        private readonly double[] _numbers = new double[Numbers];

        /// <summary>Where the seat session stands.</summary>
        public SeatState State { get; private set; }

        /// <summary>What lets the force through, or does not.</summary>
        public Safety Safety { get; private set; }

        /// <summary>Axes of the seat; 0 before there is one.</summary>
        public int Axes { get; private set; }

        /// <summary>Ticks a second; 0 before there is a seat.</summary>
        public int DeviceHz { get; private set; }

        /// <summary>Frames a second; 0 before there is a seat.</summary>
        public int NetworkHz { get; private set; }

        /// <summary>Newest tick; -1 before the first.</summary>
        public long Tick { get; private set; }

        /// <summary>Frames that were played.</summary>
        public long FramesApplied { get; private set; }

        /// <summary>Frames that were lost on the way.</summary>
        public long FramesLost { get; private set; }

        /// <summary>Impedance of the line [N s/m].</summary>
        public double ImpedanceNspm => _numbers[0];

        /// <summary>The object's spring as the server integrates it [N/m].</summary>
        public double RenderedNpm => _numbers[1];

        /// <summary>Place of the hand [m].</summary>
        public Vector PositionM => At(2);

        /// <summary>Velocity of the hand [m/s].</summary>
        public Vector VelocityMps => At(5);

        /// <summary>Force of the last tick [N]: resists motion, so the motors push the hand with minus that.</summary>
        public Vector ForceN => At(8);

        /// <summary>Place of the object [m].</summary>
        public Vector ObjectM => At(11);

        /// <summary>Velocity of the object [m/s].</summary>
        public Vector ObjectMps => At(14);

        /// <summary>Newest round trip [ms].</summary>
        public double RttMs => _numbers[17];

        /// <summary>Delay of the jitter buffer [frames].</summary>
        public double PlayoutFrames => _numbers[18];

        /// <summary>Least margin of the line from the server [J].</summary>
        public double DownMarginJ => _numbers[19];

        /// <summary>Least margin of the device [J].</summary>
        public double DeviceMarginJ => _numbers[20];

        /// <summary>Largest force so far [N].</summary>
        public double PeakForceN => _numbers[Numbers - 3];

        /// <summary>Share of the force that is let through, 0 to 1.</summary>
        public double Gain => _numbers[Numbers - 1];

        private Vector At(int first) => new Vector(_numbers[first], _numbers[first + 1], _numbers[first + 2]);

        internal void Fill(IntPtr from)
        {
            State = (SeatState)Marshal.ReadInt32(from, StateAt);
            Safety = (Safety)Marshal.ReadInt32(from, SafetyAt);
            Axes = Marshal.ReadInt32(from, AxesAt);
            DeviceHz = Marshal.ReadInt32(from, DeviceHzAt);
            NetworkHz = Marshal.ReadInt32(from, NetworkHzAt);
            Tick = Marshal.ReadInt64(from, TickAt);
            Marshal.Copy(IntPtr.Add(from, NumbersAt), _numbers, 0, Numbers);
            FramesApplied = Marshal.ReadInt64(from, DownAt + 16);
            FramesLost = Marshal.ReadInt64(from, DownAt + 24);
        }

        /// <summary>Take over all of another status.</summary>
        public void CopyFrom(SeatStatus other)
        {
            State = other.State;
            Safety = other.Safety;
            Axes = other.Axes;
            DeviceHz = other.DeviceHz;
            NetworkHz = other.NetworkHz;
            Tick = other.Tick;
            FramesApplied = other.FramesApplied;
            FramesLost = other.FramesLost;
            Array.Copy(other._numbers, _numbers, Numbers);
        }
    }
}
