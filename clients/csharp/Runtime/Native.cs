using System;
using System.Runtime.InteropServices;
using System.Text;

namespace Cogrip
{
    /// <summary>The functions of libcogrip, as cogrip.h declares them.</summary>
    internal static class Native
    {
        /// <summary>Binary interface that this was written for: COGRIP_ABI.</summary>
        internal const int Abi = 0;

        private const string Library = "cogrip";

        /// <summary>cogrip_config. Texts are UTF-8 that ends with a 0.</summary>
        [StructLayout(LayoutKind.Sequential)]
        internal struct Config
        {
            internal IntPtr Room, Name, Token, Device, Software;
            internal ulong Nonce;
            internal int Axes;
            internal double RateHz, PeakForceN, SpeedMps, SlewNps, ApparentMassKg, DampingNspm, CarriedNspm;
        }

        [DllImport(Library)] internal static extern int cogrip_abi();
        [DllImport(Library)] internal static extern IntPtr cogrip_version();
        [DllImport(Library)] internal static extern UIntPtr cogrip_driver_bytes();
        [DllImport(Library)] internal static extern IntPtr cogrip_open(
            IntPtr memory, UIntPtr bytes, byte[] target, ref Config config, UIntPtr configBytes, int allowUnencrypted,
            byte[] error, UIntPtr errorBytes);
        [DllImport(Library)] internal static extern int cogrip_run(IntPtr driver);
        [DllImport(Library)] internal static extern void cogrip_tick(
            IntPtr driver, long tick, [In] double[] positionM, IntPtr velocityMps, [Out] double[] forceN);
        [DllImport(Library, EntryPoint = "cogrip_tick")] internal static extern void cogrip_tick_without_sample(
            IntPtr driver, long tick, IntPtr positionM, IntPtr velocityMps, [Out] double[] forceN);
        [DllImport(Library)] internal static extern IntPtr cogrip_client_of(IntPtr driver);
        [DllImport(Library)] internal static extern void cogrip_handle(
            IntPtr client, uint buttons, IntPtr orientation, double gripM);
        [DllImport(Library)] internal static extern void cogrip_driver_leave(IntPtr driver, byte[] reason);
        [DllImport(Library)] internal static extern void cogrip_close(IntPtr driver);
        [DllImport(Library)] internal static extern int cogrip_done(IntPtr client);
        [DllImport(Library)] internal static extern void cogrip_rearm(IntPtr client);
        [DllImport(Library)] internal static extern void cogrip_get_status(IntPtr client, IntPtr status, UIntPtr statusBytes);
        [DllImport(Library)] internal static extern IntPtr cogrip_reason(IntPtr client);
        [DllImport(Library)] internal static extern long cogrip_now_ns();
        [DllImport(Library)] internal static extern long cogrip_sleep_until(long dueNs);

        /// <summary>UTF-8 of a text, with the 0 that ends it.</summary>
        internal static byte[] Utf8(string text) => Encoding.UTF8.GetBytes(text + "\0");

        /// <summary>The text that begins at an address.</summary>
        internal static string Text(IntPtr at)
        {
            var length = 0;
            while (Marshal.ReadByte(at, length) != 0) length++;
            var bytes = new byte[length];
            Marshal.Copy(at, bytes, 0, length);
            return Encoding.UTF8.GetString(bytes);
        }
    }

    /// <summary>Memory outside of the collector's, which ends with its object.</summary>
    internal sealed class Memory : SafeHandle
    {
        internal Memory(int bytes) : base(IntPtr.Zero, true)
        {
            SetHandle(Marshal.AllocHGlobal(bytes));
            for (var at = 0; at < bytes; at++) Marshal.WriteByte(handle, at, 0);
        }

        internal Memory(string text) : this(Native.Utf8(text).Length)
        {
            var bytes = Native.Utf8(text);
            Marshal.Copy(bytes, 0, handle, bytes.Length);
        }

        internal IntPtr At => handle;

        public override bool IsInvalid => handle == IntPtr.Zero;

        protected override bool ReleaseHandle()
        {
            Marshal.FreeHGlobal(handle);
            return true;
        }
    }

    /// <summary>A driver of the library with its memory. Its end closes the sockets.</summary>
    internal sealed class DriverHandle : SafeHandle
    {
        internal DriverHandle() : base(IntPtr.Zero, true) => SetHandle(Marshal.AllocHGlobal((int)Native.cogrip_driver_bytes()));

        /// <summary>What cogrip_open gave; zero before, and where it gave nothing.</summary>
        internal IntPtr Driver { get; set; }

        internal IntPtr Memory => handle;

        public override bool IsInvalid => handle == IntPtr.Zero;

        protected override bool ReleaseHandle()
        {
            if (Driver != IntPtr.Zero) Native.cogrip_close(Driver);
            Marshal.FreeHGlobal(handle);
            return true;
        }
    }
}
