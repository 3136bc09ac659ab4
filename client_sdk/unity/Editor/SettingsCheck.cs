using System;
using System.Collections.Generic;
using UnityEditor;

namespace Terraport.Unity.Editor
{
    /// <summary>Looks a scene's settings over before anybody plays.</summary>
    public static class SettingsCheck
    {
        /// <summary>What will not work, or not well; empty where nothing was found.</summary>
        public static List<string> Findings(TerraportScene scene)
        {
            List<string> findings = new List<string>();
            // Findings are advice: none of them keeps anybody from playing.
            CheckUrl(scene.SceneUrl, findings);
            TerraportSettings settings = scene.Settings;
            DeviceBudgets bounds = settings.ActualBudgets;
            if (bounds.creditMebibytes > bounds.maxGpuMebibytes)
            {
                findings.Add("The credit is more than everything that can be shown: a landing that is given up will cost much.");
            }
            // At 72 to 90 frames a second: two eyes are to be drawn in the same time.
            if (settings.frameBudgetMs > 5 && settings.ActualProfile == DeviceProfile.Headset)
            {
                findings.Add("A frame budget of " + settings.frameBudgetMs + " ms leaves too little of a headset's 11 to 14 ms.");
            }
            if (scene.BaseMaterial != null && !scene.BaseMaterial.HasProperty("_TerraportPushM"))
            {
                findings.Add("The base's material has no _TerraportPushM: the base is not pushed back, and will poke through the detail.");
            }
            return findings;
        }

        private static void CheckUrl(string url, List<string> findings)
        {
            if (string.IsNullOrEmpty(url))
            {
                findings.Add("There is no address yet: nothing is opened before code sets SceneUrl and calls Open.");
                return;
            }
            SceneUrl sceneUrl;
            try
            {
                sceneUrl = SceneUrl.Parse(url);
            }
            catch (TerraportException error)
            {
                findings.Add(
                    "The address is not one that can be opened: " + error.Message + ". Tokens are set from code: TerraportScene.Token.");
                return;
            }
            Uri address = new Uri(sceneUrl.Server);
            // On the machine itself there is no network in between.
            if (address.Scheme == "http" && !address.IsLoopback)
            {
                findings.Add("Over http the token and the survey can be read by everybody on the way. Use https; for a test set Project "
                    + "Settings > Player > Other Settings > Allow downloads over HTTP, and on Android also Internet Access: Require.");
            }
        }
    }
}
