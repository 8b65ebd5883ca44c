namespace Cogrip
{
    /// <summary>What a hand holds. All of it is called from the thread of a <see cref="SeatLoop"/>.</summary>
    public interface IHapticDevice
    {
        /// <summary>The seat is taken: so many ticks a second begin.</summary>
        void Begin(int hz);

        /// <summary>Read where the hand is in a tick. False, or an exception: there is no sample.</summary>
        bool Read(long tick, out Vector positionM);

        /// <summary>Push the hand until the next tick, with minus the force of the seat: it points where it pushes.</summary>
        void Push(Vector onHandN);
    }
}
