using Terraport.Wire;

namespace Terraport.Sessions
{
    /// <summary>What a session tells the server in hello, and what bounds it.</summary>
    public sealed class SessionOptions
    {
        /// <summary>Name and version of the client, for the server's logs.</summary>
        public string Client { get; set; } = "";

        /// <summary>Hard bounds of every landing; null for none.</summary>
        public Budgets Budgets { get; set; }

        /// <summary>Payload bytes under way at most, 1 or more. Half of it is granted back at a time.</summary>
        public long CreditBytes { get; set; } = StreamOptions.DefaultCreditBytes;

        /// <summary>Release radius / load radius; null takes the server's.</summary>
        public double? ReleaseFactor { get; set; }

        /// <summary>Bound on the payload bytes kept beside what is pinned.</summary>
        public long CacheBytes { get; set; } = StreamOptions.DefaultCacheBytes;

        /// <summary>The message that opens a connection.</summary>
        internal HelloMessage Hello(HeldRow[] heldRows)
        {
            return new HelloMessage {
                Protocol = new ProtocolVersion(WireLimits.ProtocolMajor, WireLimits.ProtocolMinor),
                Client = Client,
                Encoding = SegmentDecoder.Encoding,
                Budgets =
                    new BudgetsPart {
                        MaxTriangles = Budgets == null ? null : Budgets.MaxTriangles,
                        MaxBytes = Budgets == null ? null : Budgets.MaxBytes,
                        MaxSegments = Budgets == null ? null : Budgets.MaxSegments,
                        MaxGpuBytes = Budgets == null ? null : Budgets.MaxGpuBytes,
                        GpuVertexBytes = Budgets == null ? null : Budgets.GpuVertexBytes,
                        GpuFaceBytes = Budgets == null ? null : Budgets.GpuFaceBytes,
                    },
                CreditBytes = CreditBytes,
                ReleaseFactor = ReleaseFactor,
                Held = heldRows,
            };
        }
    }
}
