using System;
using System.Threading;

namespace Cogrip
{
    /// <summary>Thread that holds a seat with a device, at the seat's rate. Others read its status, and stop it.</summary>
    public sealed class SeatLoop : IDisposable
    {
        private const long SecondNs = 1000000000;
        private const int EndMs = 3000;
        private readonly string _target;
        private readonly SeatOptions _options;
        private readonly IHapticDevice _device;
        private readonly Thread _thread;
        private readonly object _lock = new object();
        private readonly SeatStatus _newest = new SeatStatus(), _published = new SeatStatus();
        private volatile bool _stopping, _rearming, _ended;
        private volatile string _reason = "", _user = "";

        /// <summary>Make a loop; <see cref="Start"/> begins it.</summary>
        public SeatLoop(string target, SeatOptions options, IHapticDevice device)
        {
            _target = target;
            _options = options;
            _device = device;
            _thread = new Thread(Hold) { IsBackground = true, Name = "cogrip", Priority = ThreadPriority.Highest };
        }

        /// <summary>True once the seat is given back, or could not be had; <see cref="Reason"/> says why.</summary>
        public bool Ended => _ended;

        /// <summary>Why the session ended badly, or the force is released; "" for neither.</summary>
        public string Reason => _reason;

        /// <summary>Name of the seat; "" before there is one.</summary>
        public string User => _user;

        /// <summary>Begin to ask for a seat.</summary>
        public void Start() => _thread.Start();

        /// <summary>Release hand and object, then leave: it takes up to a second. Returns at once.</summary>
        public void Stop() => _stopping = true;

        /// <summary>End a fault. The force ramps in from zero.</summary>
        public void Rearm() => _rearming = true;

        /// <summary>Fill a status with that of the newest tick.</summary>
        public void Read(SeatStatus into)
        {
            lock (_lock) into.CopyFrom(_published);
        }

        /// <summary>Leave, and wait for the end, at most 3 s.</summary>
        public void Dispose()
        {
            Stop();
            if (_thread.IsAlive) _thread.Join(EndMs);
        }

        private void Hold()
        {
            try
            {
                using (var seat = new Seat(_target, _options))
                    if (seat.WaitUntilSeated(() => _stopping))
                        Ticks(seat);
            }
            catch (Exception wrong) // of whatever kind: an exception that nobody catches ends the program
            {
                _reason = wrong.Message;
            }
            _ended = true;
        }

        private void Ticks(Seat seat)
        {
            var position = new double[3];
            var force = new double[3];
            var leaving = false;
            seat.Read(_newest);
            _user = seat.User;
            long hz = _newest.DeviceHz, begun = Seat.NowNs, tick = 0;
            var safety = _newest.Safety;
            var failed = "";
            _device.Begin(_newest.DeviceHz);
            while (!seat.Done)
            {
                Seat.SleepUntil(begun + tick / hz * SecondNs + tick % hz * SecondNs / hz);
                if (Sample(tick, position, ref failed)) seat.Tick(tick, position, force);
                else seat.TickWithoutSample(tick, force);
                if (!Push(new Vector(-force[0], -force[1], -force[2]), ref failed)) _stopping = true;
                if (_stopping && !leaving)
                {
                    seat.Leave(failed.Length > 0 ? "the device failed" : "the program ended");
                    leaving = true;
                }
                if (_rearming)
                {
                    _rearming = false;
                    seat.Rearm();
                }
                Publish(seat, ref safety, failed);
                var passed = Seat.NowNs - begun;
                tick = passed / SecondNs * hz + passed % SecondNs * hz / SecondNs + 1; // a tick that was missed is left out
            }
            _reason = failed.Length > 0 ? failed : seat.Reason;
        }

        private bool Sample(long tick, double[] position, ref string failed)
        {
            try
            {
                if (!_device.Read(tick, out var place)) return false;
                position[0] = place.X;
                position[1] = place.Y;
                position[2] = place.Z;
                return true;
            }
            catch (Exception wrong) // the client takes the force to zero where samples are absent
            {
                failed = "device: " + wrong.Message;
                return false;
            }
        }

        private bool Push(Vector force, ref string failed)
        {
            try
            {
                _device.Push(force);
                return true;
            }
            catch (Exception wrong)
            {
                failed = "device: " + wrong.Message;
                return false;
            }
        }

        /// <summary>Never waits for who reads: the next tick publishes as well.</summary>
        private void Publish(Seat seat, ref Safety safety, string failed)
        {
            seat.Read(_newest);
            if (_newest.Safety != safety)
            {
                safety = _newest.Safety;
                _reason = failed.Length > 0 ? failed : seat.Reason;
            }
            if (!Monitor.TryEnter(_lock)) return;
            _published.CopyFrom(_newest);
            Monitor.Exit(_lock);
        }
    }
}
