using System;

namespace Cogrip
{
    /// <summary>A simulated hand for programs without a device: a mass that a spring pulls toward a place. Frames of a screen
    /// say where, the thread of the seat moves the mass: no frame's time is in a force.</summary>
    /// <remarks>The goal runs to the place at <see cref="GoalMps"/>, the spring pulls with <see cref="HandN"/> at most, and
    /// lets go over 0.1 s where nothing has guided it for 0.25 s.</remarks>
    public sealed class GuidedHand : IHapticDevice
    {
        /// <summary>Mass of hand and device [kg]: the apparent mass of the seat.</summary>
        public const double MassKg = 0.3;

        /// <summary>Fastest that the spring's end moves [m/s].</summary>
        public const double GoalMps = 0.5;

        /// <summary>Strongest pull of the spring [N].</summary>
        public const double HandN = 5.0;

        private const double SpringNpm = 200.0, DampingNspm = 10.0, StaleS = 0.25, LetGoS = 0.1;
        private volatile Guidance _guidance = new Guidance(Vector.Zero, -1.0);
        private Vector _positionM, _velocityMps, _goalM, _onHandN;
        private long _moved;
        private double _tickS, _grip;

        /// <summary>Say where the hand is to be, from any thread.</summary>
        public void Guide(Vector placeM)
        {
            if (double.IsNaN(placeM.Length) || double.IsInfinity(placeM.Length)) return;
            _guidance = new Guidance(placeM, 1e-9 * Seat.NowNs);
        }

        /// <inheritdoc/>
        public void Begin(int hz)
        {
            _tickS = 1.0 / hz;
            _moved = 0;
            _grip = 0.0;
            _positionM = _goalM = _guidance.PlaceM;
            _velocityMps = _onHandN = Vector.Zero;
        }

        /// <inheritdoc/>
        public bool Read(long tick, out Vector positionM)
        {
            var guidance = _guidance;
            var guided = 1e-9 * Seat.NowNs - guidance.AtS < StaleS;
            for (; _moved < tick; _moved++) Move(guidance.PlaceM, guided);
            positionM = _positionM;
            return true;
        }

        /// <inheritdoc/>
        public void Push(Vector onHandN) => _onHandN = onHandN;

        /// <summary>Semi-implicit Euler.</summary>
        private void Move(Vector placeM, bool guided)
        {
            var step = _tickS / LetGoS;
            _grip = Math.Max(0.0, Math.Min(1.0, _grip + (guided ? step : -step)));
            _goalM += Within(placeM - _goalM, GoalMps * _tickS);
            var hand = _grip * Within(SpringNpm * (_goalM - _positionM), HandN) - DampingNspm * _velocityMps;
            _velocityMps += _tickS / MassKg * (hand + _onHandN);
            _positionM += _tickS * _velocityMps;
        }

        private static Vector Within(Vector vector, double most)
        {
            var length = vector.Length;
            return length > most ? most / length * vector : vector;
        }

        private sealed class Guidance
        {
            internal readonly Vector PlaceM;
            internal readonly double AtS;

            internal Guidance(Vector placeM, double atS)
            {
                PlaceM = placeM;
                AtS = atS;
            }
        }
    }
}
