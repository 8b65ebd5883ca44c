namespace Cogrip
{
    /// <summary>A place [m], a velocity [m/s] or a force [N]: x toward the user, y to the user's right, z up.</summary>
    public struct Vector
    {
        /// <summary>Toward the user.</summary>
        public readonly double X;

        /// <summary>To the user's right.</summary>
        public readonly double Y;

        /// <summary>Up.</summary>
        public readonly double Z;

        /// <summary>A vector of three numbers.</summary>
        public Vector(double x, double y, double z)
        {
            X = x;
            Y = y;
            Z = z;
        }

        /// <summary>Nothing in any direction.</summary>
        public static Vector Zero => default(Vector);

        /// <summary>The length.</summary>
        public double Length => System.Math.Sqrt(X * X + Y * Y + Z * Z);

        /// <summary>The sum.</summary>
        public static Vector operator +(Vector one, Vector other) =>
            new Vector(one.X + other.X, one.Y + other.Y, one.Z + other.Z);

        /// <summary>The difference.</summary>
        public static Vector operator -(Vector one, Vector other) =>
            new Vector(one.X - other.X, one.Y - other.Y, one.Z - other.Z);

        /// <summary>The vector, so many times as long.</summary>
        public static Vector operator *(double factor, Vector one) =>
            new Vector(factor * one.X, factor * one.Y, factor * one.Z);

        /// <inheritdoc/>
        public override string ToString() =>
            string.Format(System.Globalization.CultureInfo.InvariantCulture, "({0}, {1}, {2})", X, Y, Z);
    }
}
