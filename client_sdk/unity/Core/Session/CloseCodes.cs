namespace Terraport
{
    /// <summary>WebSocket close codes and HTTP statuses: what they mean and what a client does (protocol, section 9).</summary>
    internal static class CloseCodes
    {
        internal const int Normal = 1000, Abnormal = 1006, Malformed = 4400, Unauthorised = 4401, Timeout = 4408;
        private const int OfHttp = 4000;

        /// <summary>Whether the next attempt may succeed with the same token.</summary>
        internal static bool IsTemporary(int code)
        {
            switch (code)
            {
                case Normal:
                case Malformed:
                case Unauthorised:
                case 4403:
                case 4404:
                case 4409:
                case 4413: return false;
                // Unknown codes too: a proxy or a later server may send any.
                default: return true;
            }
        }

        /// <summary>The error code of a close without an error message before it.</summary>
        internal static string ErrorOf(int code)
        {
            switch (code)
            {
                case Malformed: return "malformed";
                case Unauthorised: return "unauthorised";
                case 4403: return "forbidden";
                case 4404: return "unknown_scene";
                case Timeout: return "timeout";
                case 4409: return "unsupported_version";
                case 4413: return "too_large";
                case 4429: return "too_many";
                case 4500: return "internal";
                case 4503: return "draining";
                default: return "closed";
            }
        }

        /// <summary>The close code of a refused handshake.</summary>
        internal static int OfHttpStatus(int status) { return ErrorOf(OfHttp + status) == "closed" ? Abnormal : OfHttp + status; }

        internal static string ErrorOfHttp(int status)
        {
            string code = ErrorOf(OfHttp + status);
            return code == "closed" ? "refused" : code;
        }

        /// <summary>What to do about an error, where the service cannot know it.</summary>
        internal static string AdviceOn(string code)
        {
            switch (code)
            {
                case "unauthorised": return "; give a token that the service knows";
                case "forbidden": return "; ask for a token that opens this scene";
                case "draining": return "; try again in a moment";
                default: return "";
            }
        }
    }
}
