using UnityEngine;

namespace Cogrip.Unity
{
    /// <summary>Holds a seat of a cogrip room, and moves this object as the room's object moves.</summary>
    /// <remarks>A thread of its own ticks the seat, at 1024 Hz as a rule; frames of the screen only say where the tool is and
    /// draw what the thread has published. Whoever has a device derives from this and returns it in <see cref="MakeDevice"/>.
    /// Places are those of the parent's frame, in metres.</remarks>
    [AddComponentMenu("Cogrip/Cogrip Seat")]
    [DisallowMultipleComponent]
    public class CogripSeat : MonoBehaviour
    {
        [SerializeField, Tooltip("A join link, or HOST:PORT of a server on this machine. A link is a secret: commit none.")]
        private string target = "127.0.0.1:47800";

        [SerializeField, Tooltip("Name of the seat; empty: any free one.")]
        private string seatName = "";

        [SerializeField, Min(0.01f), Tooltip("Largest force of the device [N].")]
        private float peakForceN = 3f;

        [SerializeField, Min(0.01f), Tooltip("Speed of the hand beyond which the force is let go [m/s].")]
        private float speedMps = 1f;

        [SerializeField, Tooltip("Where the hand is to be. Not asked for where a device is held.")]
        private Transform tool;

        [SerializeField, Tooltip("Moved to where the hand is; may be empty.")]
        private Transform hand;

        private readonly SeatStatus _status = new SeatStatus();
        private GuidedHand _guided = new GuidedHand();
        private SeatLoop[] _loop = new SeatLoop[0];
        private string _said = "";

        /// <summary>Status of the newest tick that a frame has seen.</summary>
        public SeatStatus Status => _status;

        /// <summary>End a fault, once the device is well. The force ramps in from zero.</summary>
        public void Rearm()
        {
            foreach (var loop in _loop) loop.Rearm();
        }

        /// <summary>A place of cogrip (x toward the user, y right, z up) in Unity's axes (x right, y up, z away).</summary>
        public static Vector3 ToUnity(Vector place) => new Vector3((float)place.Y, (float)place.Z, (float)-place.X);

        /// <summary>A place of Unity in cogrip's axes.</summary>
        public static Vector FromUnity(Vector3 place) => new Vector(-place.z, place.x, place.y);

        /// <summary>The device that the hand holds: without one a simulated hand, which follows the tool.</summary>
        protected virtual IHapticDevice MakeDevice() => _guided;

        /// <summary>What the seat is asked for with. Override it for what the inspector does not have.</summary>
        protected virtual SeatOptions MakeOptions() => new SeatOptions
        {
            Name = seatName, Device = "unity", Software = "unity", PeakForceN = peakForceN, SpeedMps = speedMps,
            ApparentMassKg = GuidedHand.MassKg,
        };

        /// <summary>Ask for the seat.</summary>
        protected virtual void OnEnable()
        {
            _guided = new GuidedHand();
            Guide();
            _loop = new[] { new SeatLoop(target, MakeOptions(), MakeDevice()) };
            _loop[0].Start();
        }

        /// <summary>Give the seat back: the thread releases hand and object, and ends by itself within a second.</summary>
        protected virtual void OnDisable()
        {
            foreach (var loop in _loop) loop.Stop();
            _loop = new SeatLoop[0];
        }

        /// <summary>Draw, and say where the tool is. No force is computed here.</summary>
        protected virtual void Update()
        {
            Guide();
            foreach (var loop in _loop)
            {
                loop.Read(_status);
                if (loop.Reason != _said && loop.Reason.Length > 0) Debug.LogWarning("cogrip: " + loop.Reason, this);
                _said = loop.Reason;
            }
            if (_status.DeviceHz == 0) return;
            transform.localPosition = ToUnity(_status.ObjectM);
            if (hand) hand.localPosition = ToUnity(_status.PositionM);
        }

        private void Guide()
        {
            if (tool) _guided.Guide(FromUnity(tool.localPosition));
        }
    }
}
