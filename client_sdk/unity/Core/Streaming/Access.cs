using System;

namespace Terraport
{
    /// <summary>Gives the token of each connection, and knows when another attempt is worth while.</summary>
    internal sealed class Access
    {
        private string token;
        private Func<string> provider;
        private string shown;

        internal Access(string token, Func<string> provider)
        {
            this.token = token;
            this.provider = provider;
        }

        /// <summary>The present token; null for none. Fails as its function does.</summary>
        internal string Show()
        {
            shown = provider == null ? token : provider();
            return shown;
        }

        /// <summary>Whether there is another token than the one shown last, which was refused.</summary>
        internal bool HasNewer()
        {
            try
            {
                return provider != null && provider() != shown;
            }
            catch (Exception)
            {
                // Not known: the next attempt asks again, and says why that failed.
                return true;
            }
        }

        /// <summary>Show this token from now on, asking nobody; whether it is another one. Null changes nothing.</summary>
        internal bool Replace(string newToken)
        {
            if (newToken == null || newToken == shown) return false;
            token = newToken;
            provider = null;
            return true;
        }
    }
}
