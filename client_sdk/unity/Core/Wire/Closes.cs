using System.Collections.Generic;

namespace Terraport.Wire
{
    /// <summary>What close codes mean (section 11).</summary>
    public static class Closes
    {
        /// <summary>The connection broke, or never came about.</summary>
        public const int Abnormal = 1006;

        /// <summary>Closed by agreement (RFC 6455, section 7.4.1).</summary>
        public const int Normal = 1000;

        /// <summary>What a client does after a close with this code; every code that is not listed may pass, so again.</summary>
        public static AfterClose After(int closeCode)
        {
            switch (closeCode)
            {
                case Normal: return AfterClose.Done;
                case CloseCodes.Unauthorised: return AfterClose.Token;
                case CloseCodes.Malformed:
                case CloseCodes.Forbidden:
                case CloseCodes.UnknownScene:
                case CloseCodes.UnsupportedVersion:
                case CloseCodes.TooLarge: return AfterClose.Stop;
                // Unknown codes too: a proxy or a later server may send any.
                default: return AfterClose.Again;
            }
        }

        /// <summary>The error code that a close code stands for, where a close came without an error message; else "closed".</summary>
        public static string ErrorOf(int closeCode)
        {
            // A dozen entries, asked once a connection: not worth an inverse table.
            foreach (KeyValuePair<string, int> entry in CloseCodes.ByError)
            {
                if (entry.Value == closeCode) return entry.Key;
            }
            return "closed";
        }

        /// <summary>The close code for a refused handshake's HTTP status (section 2.4); 1006 for a status that is none of them.</summary>
        public static int OfHttpStatus(int status)
        {
            foreach (KeyValuePair<int, int> entry in CloseCodes.ByHttpStatus)
            {
                if (entry.Key == status) return entry.Value;
            }
            return Abnormal;
        }
    }
}
