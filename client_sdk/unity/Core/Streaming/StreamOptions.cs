using System;

namespace Terraport
{
    /// <summary>What a stream is opened with. Set it up, then do not change it while a stream uses it.</summary>
    public sealed class StreamOptions
    {
        /// <summary>Credit unless another is set: 16 MiB.</summary>
        public const long DefaultCreditBytes = 16L * 1024 * 1024;

        /// <summary>Bound of the memory for payloads unless another is set: 96 MiB.</summary>
        public const long DefaultCacheBytes = 96L * 1024 * 1024;

        /// <summary>Bound of the folder on disk unless another is set: 1 GiB.</summary>
        public const long DefaultDiskBytes = 1024L * 1024 * 1024;

        /// <summary>URL ending in /scenes/{id}; http, https, ws or wss.</summary>
        public string SceneUrl { get; set; }

        /// <summary>Bearer token; null for a server that asks for none. Never part of a URL.</summary>
        public string Token { get; set; }

        /// <summary>
        /// Asked for the present token before each connection, and once more where that was refused after a welcome: with another
        /// one the session goes on, with everything held. Null takes <see cref="Token"/> alone.
        /// </summary>
        /// <remarks>
        /// Called on the thread that pumps the stream, of a <see cref="ThreadedStream"/> that is its own; it must not wait. An
        /// exception counts as a connection that did not come about.
        /// </remarks>
        public Func<string> TokenProvider { get; set; }

        /// <summary>Hard bounds of every landing; null for none. Kept, not copied: do not change it while a stream uses it.</summary>
        public Budgets Budgets { get; set; }

        /// <summary>Payload bytes kept in memory beside what is shown or on its way; 0 keeps nothing else.</summary>
        public long CacheBytes { get; set; } = DefaultCacheBytes;

        /// <summary>
        /// Folder in which payloads are kept from one run to the next, shared by all scenes; null for none. Whoever may read it may read
        /// the surveys. What cannot be kept there (a full disk, no such folder) is not; nothing fails.
        /// </summary>
        public string DiskFolder { get; set; }

        /// <summary>Bytes kept in <see cref="DiskFolder"/>, over all scenes; what was used longest ago goes first.</summary>
        public long DiskBytes { get; set; } = DefaultDiskBytes;

        /// <summary>
        /// Payload bytes under way at most. Half of it is granted back at a time: a larger one saves messages, a smaller one
        /// bounds what lies in buffers when a landing is superseded.
        /// </summary>
        public long CreditBytes { get; set; } = DefaultCreditBytes;

        /// <summary>Release radius / load radius, 1 to 4; null takes the server's.</summary>
        public double? ReleaseFactor { get; set; }

        /// <summary>Name and version of the client for the server's logs, at most 128 characters; null for this package's own.</summary>
        public string Client { get; set; }
    }
}
