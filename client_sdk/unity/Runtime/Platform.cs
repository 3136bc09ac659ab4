using System;
using System.IO;
using System.Threading.Tasks;
using UnityEngine;

namespace Terraport.Unity
{
    /// <summary>What differs between platforms: a browser has no threads and no sockets but its own.</summary>
    internal static class Platform
    {
#if UNITY_WEBGL && !UNITY_EDITOR
        internal static bool HasThreads => false;

        /// <summary>Runs work on another thread; null without threads.</summary>
        internal static Func<Action, Task> RunAside => null;

        /// <summary>Where payloads are kept from one run to the next; null for nowhere.</summary>
        internal static string DiskFolder => null;

        internal static IHttp MakeHttp() { return new WebRequestHttp(); }

        internal static ITransport Connect(Uri url, string token) { return new WebGlTransport(url, token); }
#else
        internal static bool HasThreads => true;

        /// <summary>Runs work on another thread.</summary>
        internal static Func<Action, Task> RunAside => Task.Run;

        /// <summary>Where payloads are kept from one run to the next; the system may empty it.</summary>
        internal static string DiskFolder => Path.Combine(Application.temporaryCachePath, "terraport");

        internal static IHttp MakeHttp() { return new SystemHttp(); }

        internal static ITransport Connect(Uri url, string token) { return new WebSocketTransport(url, token); }
#endif
    }
}
