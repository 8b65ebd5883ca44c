namespace Cogrip
{
    /// <summary>What a hand is held with. A number that is 0 takes the value in brackets.</summary>
    public sealed class SeatOptions
    {
        /// <summary>Room of the server; the link's comes first [any].</summary>
        public string Room { get; set; } = "";

        /// <summary>Name of the seat [any free one].</summary>
        public string Name { get; set; } = "";

        /// <summary>Secret of the join link; the link's comes first.</summary>
        public string Token { get; set; } = "";

        /// <summary>What the device is called, at most 200 bytes of UTF-8.</summary>
        public string Device { get; set; } = "csharp";

        /// <summary>Version of the program, at most 40 bytes of UTF-8.</summary>
        public string Software { get; set; } = "csharp";

        /// <summary>Axes of the device, 1 to 3.</summary>
        public int Axes { get; set; } = 3;

        /// <summary>Fastest loop that the device allows [Hz].</summary>
        public double RateHz { get; set; } = 1024.0;

        /// <summary>Largest force, of all axes together [N]. Must be given.</summary>
        public double PeakForceN { get; set; }

        /// <summary>Over-speed limit [m/s]. Must be given.</summary>
        public double SpeedMps { get; set; }

        /// <summary>Steepest force [1000 N/s, and never more].</summary>
        public double SlewNps { get; set; }

        /// <summary>Mass of the device at the hand [0.1 kg].</summary>
        public double ApparentMassKg { get; set; }

        /// <summary>Damping of the device itself [0 N s/m].</summary>
        public double DampingNspm { get; set; }

        /// <summary>Largest damping that the device renders without shaking [no bound, N s/m].</summary>
        public double CarriedNspm { get; set; }

        /// <summary>True where a person has allowed to talk to another machine unencrypted.</summary>
        public bool AllowUnencrypted { get; set; }
    }
}
