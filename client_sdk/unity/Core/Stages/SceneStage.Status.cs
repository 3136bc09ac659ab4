using System.Globalization;

namespace Terraport
{
    /// <content>What is told of the stage.</content>
    public sealed partial class SceneStage
    {
        /// <summary>Where the newest landing stands.</summary>
        public LandingStatus Status
        {
            get {
                LandingRecord landing = residency.Newest;
                // A value, put together at each call: a caller may keep it.
                var status = new LandingStatus { Phase = Phase(), Missing = residency.Missing(), Fraction = residency.Fraction() };
                if (landing != null)
                {
                    status.Landing = landing.Landing;
                    status.Position = landing.Position;
                    status.RadiusM = landing.RadiusM;
                    status.Plan = landing.Plan;
                    status.ReadyMs = landing.ReadyMs;
                    status.PresentableMs = landing.PresentableMs;
                    status.PayloadBytes = landing.PayloadBytes;
                    status.Refusal = landing.Refusal;
                }
                return status;
            }
        }

        /// <summary>What the stage holds and does now.</summary>
        public StageStats Stats
        {
            get {
                return new StageStats {
                    UploadedSegments = uploads.Count,
                    VisibleSegments = residency.Visible.Length,
                    InFlight = residency.InFlight,
                    SpareGpuBytes = residency.SpareBytes,
                    UpdateMs = updateMs,
                    UpdateMaxMs = updateMaxMs,
                };
            }
        }

        /// <summary>
        /// What is visible, as a value: equal texts mean the same segments and the same hidden base faces. Changes only in a swap.
        /// </summary>
        public string VisibleDigest
        {
            get {
                uint hash = 0;
                foreach (uint segment in residency.Visible)
                {
                    // Of a set: independent of order, and cheap enough for every frame of a test.
                    hash ^= CoverCounters.Mix(segment);
                }
                string form = "{0}:{1:x8}:{2}:{3:x8}";
                int hidden = baseFaces.DrawnHiddenCount;
                return string.Format(CultureInfo.InvariantCulture, form, residency.Visible.Length, hash, hidden, baseFaces.DrawnHiddenHash);
            }
        }

        private LandingPhase Phase()
        {
            LandingRecord landing = residency.Newest;
            if (landing == null)
            {
                return LandingPhase.Idle;
            }
            if (landing.Refusal != null)
            {
                return LandingPhase.Refused;
            }
            if (landing.Swapped == LandingRecord.Extent.Full)
            {
                return LandingPhase.Shown;
            }
            // Presentable means that a swap would show it now: not while the base itself is missing.
            LandingRecord.Extent extent = CanSwap ? residency.Presentable() : LandingRecord.Extent.Nothing;
            if (extent != LandingRecord.Extent.Nothing)
            {
                return extent == LandingRecord.Extent.Full ? LandingPhase.Presentable : LandingPhase.DegradedPresentable;
            }
            return landing.Plan == null ? LandingPhase.Planning : LandingPhase.Streaming;
        }
    }
}
