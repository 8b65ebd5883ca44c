using System;
using System.Runtime.InteropServices;

namespace Cogrip
{
    /// <summary>A seat that cannot be had. The message says why in one line.</summary>
    public sealed class SeatException : Exception
    {
        /// <summary>An error with its reason.</summary>
        public SeatException(string message) : base(message)
        {
        }
    }

    /// <summary>One person's seat at the object of a server's room. One thread at a time may use it; <see cref="SeatLoop"/> is
    /// such a thread.</summary>
    public sealed class Seat : IDisposable
    {
        private const int ErrorBytes = 256;
        private const long PauseNs = 2000000;
        private readonly DriverHandle _handle;
        private readonly Memory _status = new Memory(SeatStatus.Bytes);
        private readonly IntPtr _driver, _client;

        /// <summary>Begin to ask for a seat.</summary>
        /// <param name="target">A join link, or HOST:PORT of an unencrypted server.</param>
        /// <param name="options">What the hand is held with.</param>
        /// <exception cref="SeatException">No libcogrip, or one of another ABI; or target or options cannot be.</exception>
        public Seat(string target, SeatOptions options)
        {
            var abi = LibraryAbi();
            if (abi != Native.Abi)
                throw new SeatException(
                    $"libcogrip: its ABI is {abi}, this package needs {Native.Abi}; install the libcogrip that came with it");
            _handle = new DriverHandle();
            var error = new byte[ErrorBytes];
            using (Memory room = new Memory(options.Room), name = new Memory(options.Name), token = new Memory(options.Token),
                device = new Memory(options.Device), software = new Memory(options.Software))
            {
                var config = new Native.Config
                {
                    Room = room.At, Name = name.At, Token = token.At, Device = device.At, Software = software.At,
                    Axes = options.Axes, RateHz = options.RateHz, PeakForceN = options.PeakForceN, SpeedMps = options.SpeedMps,
                    SlewNps = options.SlewNps, ApparentMassKg = options.ApparentMassKg, DampingNspm = options.DampingNspm,
                    CarriedNspm = options.CarriedNspm,
                };
                _driver = _handle.Driver = Native.cogrip_open(
                    _handle.Memory, Native.cogrip_driver_bytes(), Native.Utf8(target), ref config,
                    (UIntPtr)Marshal.SizeOf(config), options.AllowUnencrypted ? 1 : 0, error, (UIntPtr)ErrorBytes);
            }
            if (_driver == IntPtr.Zero)
            {
                Dispose();
                throw new SeatException(System.Text.Encoding.UTF8.GetString(error, 0, Array.IndexOf(error, (byte)0)));
            }
            _client = Native.cogrip_client_of(_driver);
        }

        /// <summary>Version of libcogrip.</summary>
        public static string LibraryVersion => Native.Text(Native.cogrip_version());

        /// <summary>Monotonic clock of libcogrip [ns].</summary>
        public static long NowNs => Native.cogrip_now_ns();

        /// <summary>True once the session is over and no force is left.</summary>
        public bool Done
        {
            get
            {
                Check();
                return Native.cogrip_done(_client) != 0;
            }
        }

        /// <summary>Why the session ended badly, or the force is released; "" for neither.</summary>
        public string Reason
        {
            get
            {
                Check();
                return Native.Text(Native.cogrip_reason(_client));
            }
        }

        /// <summary>Room that the seat is in; "" before there is one.</summary>
        public string Room => TextAt(SeatStatus.RoomAt);

        /// <summary>Name of the seat; "" before there is one.</summary>
        public string User => TextAt(SeatStatus.UserAt);

        /// <summary>Sleep until the clock of libcogrip shows a time. Returns what it shows then.</summary>
        public static long SleepUntil(long dueNs)
        {
            var now = NowNs;
            while (now < dueNs) now = Native.cogrip_sleep_until(dueNs);
            return now;
        }

        /// <summary>Receive, let time pass and send: every few milliseconds until there is a seat or none.</summary>
        public SeatState Run()
        {
            Check();
            return (SeatState)Native.cogrip_run(_driver);
        }

        /// <summary>Wait until the seat is taken, or `stop` says so. Returns whether it is.</summary>
        /// <exception cref="SeatException">The server refuses, or does not answer for 3 s.</exception>
        public bool WaitUntilSeated(Func<bool> stop)
        {
            for (var state = Run(); state != SeatState.Seated; state = Run())
            {
                if (state == SeatState.Closed) throw new SeatException(Reason);
                if (stop()) return false;
                SleepUntil(NowNs + PauseNs);
            }
            return true;
        }

        /// <summary>A whole tick, without taking memory. Never blocks.</summary>
        /// <param name="tick">Number of the period of <see cref="SeatStatus.DeviceHz"/>; missed ones are left out.</param>
        /// <param name="positionM">Three numbers: where the hand is.</param>
        /// <param name="forceN">Three numbers, to be filled: the motors push the hand with minus that.</param>
        public void Tick(long tick, double[] positionM, double[] forceN)
        {
            Check();
            Fits(positionM);
            Fits(forceN);
            Native.cogrip_tick(_driver, tick, positionM, IntPtr.Zero, forceN);
        }

        /// <summary>A tick in which the device gave no sample.</summary>
        public void TickWithoutSample(long tick, double[] forceN)
        {
            Check();
            Fits(forceN);
            Native.cogrip_tick_without_sample(_driver, tick, IntPtr.Zero, IntPtr.Zero, forceN);
        }

        /// <summary>Buttons that are down (bit k: button k + 1), before <see cref="Tick"/>.</summary>
        public void Buttons(uint down)
        {
            Check();
            Native.cogrip_handle(_client, down, IntPtr.Zero, double.NaN);
        }

        /// <summary>Release hand and object, then leave: go on with ticks until <see cref="Done"/>.</summary>
        public void Leave(string reason)
        {
            Check();
            Native.cogrip_driver_leave(_driver, Native.Utf8(reason));
        }

        /// <summary>End a fault. The force ramps in from zero.</summary>
        public void Rearm()
        {
            Check();
            Native.cogrip_rearm(_client);
        }

        /// <summary>Fill a status, without taking memory.</summary>
        public void Read(SeatStatus into)
        {
            Check();
            Native.cogrip_get_status(_client, _status.At, (UIntPtr)SeatStatus.Bytes);
            into.Fill(_status.At);
        }

        /// <summary>Close the sockets. <see cref="Leave"/> comes before, or the server notices the silence.</summary>
        public void Dispose()
        {
            _handle.Dispose();
            _status.Dispose();
        }

        private static int LibraryAbi()
        {
            try
            {
                return Native.cogrip_abi();
            }
            catch (DllNotFoundException)
            {
                throw new SeatException(
                    "libcogrip was not found; install it (clients/c/CMakeLists.txt) where programs look for libraries");
            }
            catch (EntryPointNotFoundException)
            {
                throw new SeatException("libcogrip: not the library of clients/c; install that");
            }
        }

        private static void Fits(double[] vector)
        {
            if (vector.Length < 3) throw new ArgumentException($"a vector of {vector.Length} numbers: give 3");
        }

        private string TextAt(int place)
        {
            Check();
            Native.cogrip_get_status(_client, _status.At, (UIntPtr)SeatStatus.Bytes);
            return Native.Text(IntPtr.Add(_status.At, place));
        }

        private void Check()
        {
            if (_handle.IsClosed) throw new ObjectDisposedException(nameof(Seat));
        }
    }
}
