using System;

namespace Terraport
{
    /// <summary>How a scene is visited.</summary>
    internal sealed class SceneClientOptions
    {
        internal SessionOptions Session = new SessionOptions();

        /// <summary>Returns the present token; null for none.</summary>
        internal Func<string> Token = () => null;

        /// <summary>Begins a connection to an address with a token.</summary>
        internal Func<Uri, string, ITransport> Connect = (url, token) => new WebSocketTransport(url, token);

        /// <summary>Threads that decode; 0 for none: then it is done within the frames' budgets.</summary>
        internal int DecodeThreads = 2;

        /// <summary>Bytes of segments on the graphics card that are not needed now: places that the user returns to.</summary>
        internal long SpareGpuBytes = 64 << 20;

        /// <summary>Folder of the disk cache, and its bytes; null or 0 for none.</summary>
        internal string DiskFolder;
        internal long DiskBytes;

        internal bool AutoShow = true;

        /// <summary>Landings ask for a ring of the coarser level, in scenes that have one.</summary>
        internal bool ShowsCoarse = true;
    }
}
